"""Scores below which detections are not worth tracking, chosen on training scenes."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

from ..types import Task

STORE = Path(__file__).with_suffix(".toml")


def stored_cuts(task: Task) -> dict[str, float]:
    """The least score per class for the task's detector, by the part of its name before the first hyphen.

    Classes, and detectors, that were given no cut are missing: all their detections are tracked.
    """
    cuts = _read_store().get(task.detector.split("-", maxsplit=1)[0], {})
    return {name: cut for name, cut in cuts.items() if name in task.classes}


@cache
def _read_store() -> dict[str, dict[str, float]]:
    return tomllib.loads(STORE.read_text(encoding="utf-8"))
