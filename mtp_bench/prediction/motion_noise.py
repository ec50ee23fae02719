"""Motion noise fitted on training splits, as the kinematic predictors use it."""

from __future__ import annotations

import tomllib
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UnknownNameError
from ..similar import similar_class
from ..types import RecordT, Task
from .kalman import NoiseTable

_STORE = Path(__file__).with_suffix(".toml")


def condition(task: Task) -> str:
    """Name of the fit for a task: its domain, what is observed, and in which frame."""
    return f"{task.motion_noise or task.env_id}-{_observed(task)}-{_frame(task)}"


def stored_noise(task: Task) -> NoiseTable:
    """The noise table for the task's condition: its own fit, else the most similar one of those that know most.

    The task's card names its domain, where objects move alike. Most similar: the same domain and another variant of the
    detector; the same domain and another detector; another domain. Among equals, and where a card names no domain, the
    detector decides. True boxes and detections, moving and still frames never stand in for each other. Raises
    UnknownNameError if nothing is left.
    """
    return noise_of(NoiseTable, most_similar(read_store(_STORE), task))


def most_similar(store: dict[str, dict[str, dict[str, Any]]], task: Task) -> list[dict[str, Any]]:
    """What is stored of each class of the task under its condition, or the most similar one, see `stored_noise`."""
    similar = [name for name in store if _likeness(name, task) > 0]
    if not similar:
        raise UnknownNameError("motion noise", condition(task), store, "fit it with `mtp-bench train`")
    known = {name: sum(class_name in store[name] for class_name in task.classes) for name in similar}
    best = max(similar, key=lambda name: (known[name], _likeness(name, task)))
    found = []
    for class_name in task.classes:
        like = similar_class(class_name, store[best])
        if like is None:
            raise UnknownNameError(f"class of motion noise {best!r}", class_name, store[best])
        found.append(store[best][like])
    return found


def _likeness(name: str, task: Task) -> int:
    """How well the stored condition suits the task; 0: not at all."""
    domain, observed, frame = name.rsplit("-", 2)
    wanted = _observed(task)
    if frame != _frame(task) or (observed == "truth") != (wanted == "truth"):
        return 0
    same_family = observed.split("_")[-1] == wanted.split("_")[-1]
    mine = task.motion_noise
    near = 4 * (domain.split("_")[0] == mine.split("_")[0]) + 2 * (domain == mine)  # nuScenes_mini is like nuScenes
    return 1 + same_family + 2 * (observed == wanted) + near


def _observed(task: Task) -> str:
    """What pasts are made of; variants of a detector ("kitti_pointrcnn-hard") share a fit."""
    return "truth" if task.observe == "truth" else task.detector.split("-")[0]


def _frame(task: Task) -> str:
    return "world" if task.ego_motion else "ego"


def noise_of(kind: type[RecordT], rows: list[dict[str, Any]]) -> RecordT:
    """A `NoiseTable` or another ``kind`` of noise from one mapping of field to value(s) per class."""
    names = [field.name for field in fields(kind)]
    noise: RecordT = kind(**{name: np.array([row[name] for row in rows], dtype=np.float64) for name in names})
    return noise


@cache
def read_store(path: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """What is stored of each class under each condition."""
    return tomllib.loads(path.read_text(encoding="utf-8"))
