"""Observations that no scene holds: no detection at all, and as many as fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..env.spaces import observation_space
from ..types import Task

Observation = dict[str, NDArray[Any]]
_APART = 6.0  # m between detections
_SPEED = 2.0  # m/s along x


def extreme_frames(task: Task) -> list[tuple[str, Observation]]:
    """Nothing, a full frame three times, nothing twice, and full again: [(what, observation)]."""
    plan = [False, True, True, True, False, False, True]
    return [
        (f"frame {t} ({'as many detections as fit' if full else 'no detections'})", _frame(task, t, full))
        for t, full in enumerate(plan)
    ]


def _frame(task: Task, t: int, full: bool) -> Observation:
    space: Any = observation_space(task)
    observation = {name: np.zeros(part.shape, dtype=part.dtype) for name, part in space.spaces.items()}
    observation["detection_class"][:] = -1
    if "detection_id" in observation:
        observation["detection_id"][:] = -1
    observation["time"][...] = t * task.dt
    observation["dt"][...] = task.dt if t else 0.0
    if full:
        _fill(observation, task, t)
    return observation


def _fill(observation: Observation, task: Task, t: int) -> None:
    place = np.arange(task.detections)
    side = int(np.ceil(np.sqrt(task.detections)))
    observation["detection_box"][:, 0] = _APART * (place % side) + _SPEED * t * task.dt
    observation["detection_box"][:, 1] = _APART * (place // side)
    observation["detection_box"][:, 4:] = [4.0, 1.8, 1.5]
    observation["detection_score"][:] = 1.0
    observation["detection_class"][:] = place % len(task.classes)
    observation["detection_valid"][:] = 1
    if task.velocity:
        observation["detection_velocity"][:, 0] = _SPEED
    if "detection_id" in observation:
        observation["detection_id"][:] = place
