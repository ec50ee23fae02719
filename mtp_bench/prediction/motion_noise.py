"""Motion noise fitted on training splits: TOML files in ``motion_noise/``, one per domain where objects move alike."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UnknownNameError
from ..similar import of_kind, similar_class
from ..tracking.parameters import family_of
from ..types import Task
from .kalman import NoiseTable

FOLDER = Path(__file__).with_name("motion_noise")
Noise = Mapping[str, Any]  # field of `NoiseTable` -> value(s) of one class


def stored_noise(task: Task) -> NoiseTable:
    """The noise table for the task's condition: its own fit, else the most similar one of those that know most classes.

    A class of the same kind (vehicles, two wheels, people) counts as known. A condition is a domain, as the task's card
    names it, what is observed and in which frame. Most similar: the same domain and another variant of the detector;
    the same domain and another detector; another domain. Among equals, and if a card names no domain, the detector
    decides. True boxes and detections, moving and still frames never stand in for each other. Raises UnknownNameError
    if no stored condition is left.
    """
    stored = _read_folder(FOLDER)
    similar = [name for name in stored if _similarity(name, task) > 0]
    if not similar:
        raise UnknownNameError("motion noise", condition(task), stored, "fit it with `mtp-bench train`")
    known = {
        name: sum(kind in stored[name] or of_kind(kind, stored[name]) is not None for kind in task.classes)
        for name in similar
    }
    best = max(similar, key=lambda name: (known[name], _similarity(name, task)))
    rows = []
    for class_name in task.classes:
        like = similar_class(class_name, stored[best])
        if like is None:
            raise UnknownNameError(f"class of motion noise {best!r}", class_name, stored[best])
        rows.append(stored[best][like])
    return noise_table(rows)


def noise_table(rows: Sequence[Noise]) -> NoiseTable:
    """A noise table from the noise of each class."""
    names = [field.name for field in fields(NoiseTable)]
    return NoiseTable(**{name: np.array([row[name] for row in rows], dtype=np.float64) for name in names})


def observed(task: Task) -> str:
    """Name of the task's fit in the file of its domain: source of the pasts, and frame."""
    pasts = "truth" if task.observe == "truth" else family_of(task.detector)
    return f"{pasts}-{'world' if task.ego_motion else 'ego'}"


def condition(task: Task) -> str:
    """Name of the fit for a task: the domain that its card names, else the env itself, and what is observed."""
    return f"{task.motion_noise or task.env_id}-{observed(task)}"


def _similarity(name: str, task: Task) -> int:
    """Similarity of the stored condition ``name`` to the task's; 0: it cannot stand in."""
    stored_domain, pasts, frame = name.rsplit("-", 2)
    wanted, wanted_frame = observed(task).rsplit("-", 1)
    if frame != wanted_frame or (pasts == "truth") != (wanted == "truth"):
        return 0
    same_family = pasts.split("_")[-1] == wanted.split("_")[-1]
    mine = task.motion_noise
    # A name before "_" is a domain of its own: nuScenes_mini is like nuScenes.
    near = 4 * (stored_domain.split("_")[0] == mine.split("_")[0]) + 2 * (stored_domain == mine)
    return 1 + same_family + 2 * (pasts == wanted) + near


@cache
def _read_folder(folder: Path) -> dict[str, dict[str, Noise]]:
    """The noise of each class under each condition, in the order that the files state."""
    files = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.toml"))}
    order = {name: content.pop("order", math.inf) for name, content in files.items()}
    return {
        f"{name}-{fit}": rows
        for name, content in sorted(files.items(), key=lambda file: order[file[0]])
        for fit, rows in content.items()
    }
