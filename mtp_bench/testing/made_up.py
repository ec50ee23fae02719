"""Observations that no scene holds: no detection at all, and as many as fit."""

from __future__ import annotations

import numpy as np

from ..env.observation import Feed
from ..types import Observation, Task, starts_of

_APART = 6.0  # m between detections
_SPEED = 2.0  # m/s along x
_FULL = np.array([False, True, True, True, False, False, True])


def extreme_frames(task: Task) -> list[tuple[str, Observation]]:
    """Nothing, a full frame three times, nothing twice, and full again: [(what, observation)]."""
    frames, size = len(_FULL), task.detections
    frame, place = np.repeat(np.flatnonzero(_FULL), size), np.tile(np.arange(size), int(_FULL.sum()))
    side = int(np.ceil(np.sqrt(size)))
    box = np.tile([0.0, 0, 0, 0, 4.0, 1.8, 1.5], (len(place), 1))
    box[:, 0] = _APART * (place % side) + _SPEED * frame * task.dt
    box[:, 1] = _APART * (place // side)
    feed = Feed(
        start=starts_of(size * _FULL),
        size=size,
        box=box,
        velocity=np.tile([_SPEED if task.velocity else 0.0, 0.0], (len(place), 1)),
        score=np.ones(len(place)),
        class_id=place % len(task.classes),
        object_id=place if task.observe == "truth" else None,
        ego=np.zeros((frames, 4)),
        time=task.dt * np.arange(frames),
        dt=np.where(np.arange(frames) > 0, task.dt, 0.0),
        dropped=np.zeros(frames, dtype=np.int64),
    )
    words = {True: "as many detections as fit", False: "no detections"}
    return [(f"frame {t} ({words[bool(_FULL[t])]})", feed.observe(t)) for t in range(frames)]
