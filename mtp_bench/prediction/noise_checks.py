"""What a motion noise of one's own must be, for every predictor that filters with one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import ShapeError
from ..shapes import require_finite, require_shape
from ..types import Task


def require_past(past: int | None) -> None:
    """Raise ShapeError unless a filter may use ``past`` frames of history."""
    if past is not None and past < 1:
        raise ShapeError(f"past is {past}, expected 1 or more frames")


def require_noise(noise: Any, axes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise ShapeError unless the covariances of all states can be positive definite.

    ``axes``: those of each field behind its axis of classes.
    """
    classes = len(noise.measurement)
    for name, behind in axes.items():
        values = getattr(noise, name)
        require_shape(f"noise.{name}", values, (classes, *behind))
        require_finite(f"noise.{name}", values)
        above = name in ("measurement", "speed")  # others may be 0
        if not (values > 0 if above else values >= 0).all():
            raise ShapeError(f"noise.{name} holds {values.min()}, expected numbers {'above 0' if above else '>= 0'}")


def require_classes(noise: Any, task: Task) -> None:
    """Raise ShapeError unless the noise has a row for each class of the task."""
    if len(noise.measurement) != len(task.classes):
        raise ShapeError(f"got noise of {len(noise.measurement)} classes, {task.env_id} has {len(task.classes)}")
