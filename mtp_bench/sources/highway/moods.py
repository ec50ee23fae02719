"""How people walk beside the social forces: they stroll, slow down, stop, hesitate and turn back."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .drift import Drift

_HASTE, _HASTE_MEMORY = 0.12, 2.5  # share of the pace, s
_BEARING, _BEARING_MEMORY = 0.12, 3.0  # rad, s
_STOP = 1 / 300.0  # 1/s
_SHORT, _LONG, _LONG_ONES = (0.8, 4.0), (15.0, 50.0), 0.6  # s, s, share of stops
_STAND = 0.26  # share of the groups who stand when they come first into the world
_BACK = 1 / 500.0  # 1/s, who turns back
_READY = 2.5  # 1/s, who steps on a free crossing
_HESITATE, _HESITATION = 1 / 12.0, (0.5, 1.2)  # 1/s, s on a crossing
_SLOW = 0.45  # share of the pace that is left then


class Moods:
    """The moods of everybody on foot; companions stop, go on and turn back together."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._dt, self._rng = dt, rng
        self._haste = Drift(_HASTE, _HASTE_MEMORY, dt, rng)
        self._bearing = Drift(_BEARING, _BEARING_MEMORY, dt, rng)
        self._stops: dict[int, float] = {}  # s that are left, by group
        self._slow: dict[int, float] = {}
        self.ready: set[int] = set()  # groups who would step on a free crossing now
        self.turning: set[int] = set()  # groups who turn back now

    def stand(self, group: int) -> None:
        """Lets a group who is there from the start perhaps stand."""
        if self._rng.uniform() < _STAND:
            self._stops[group] = float(self._rng.uniform(*_LONG))

    def step(self, groups: Ints) -> None:
        """Moods of ``groups`` ``[M]`` after ``dt`` seconds, of everybody on foot."""
        present = np.unique(groups).tolist()
        draw = self._rng.uniform(size=(len(present), 5))
        self._stops = {g: left - self._dt for g, left in self._stops.items() if left > 0}
        self._slow = {g: left - self._dt for g, left in self._slow.items() if left > 0}
        for group, (stop, lasting, length, slow, _) in zip(present, draw.tolist(), strict=True):
            if group not in self._stops and stop < _STOP * self._dt:
                least, most = _LONG if lasting < _LONG_ONES else _SHORT
                self._stops[group] = least + (most - least) * length
            if group not in self._slow and slow < _HESITATE * self._dt:
                self._slow[group] = _HESITATION[0] + (_HESITATION[1] - _HESITATION[0]) * length
        last = draw[:, 4].tolist()  # low: ready, high: turns back
        self.ready = {g for g, u in zip(present, last, strict=True) if u < _READY * self._dt}
        self.turning = {g for g, u in zip(present, last, strict=True) if u > 1.0 - _BACK * self._dt}

    def pace(self, pace: Floats, numbers: Ints, groups: Ints, crossing: Bools) -> Floats:
        """Speeds ``[M]`` that people like now, from their ``pace`` ``[M]``; nobody stops on a ``crossing`` ``[M]``."""
        stops = _among(groups, self._stops) & ~crossing
        slow = np.where(_among(groups, self._slow) & crossing, _SLOW, 1.0)
        haste = np.clip(1.0 + self._haste.step(numbers), 0.5, 1.3)
        return np.asarray(pace * slow * haste * ~stops)

    def heading_for(self, way: Floats, numbers: Ints, crossing: Bools) -> Floats:
        """The ways to the goals ``[M, 2]``, turned a little; straight over a ``crossing`` ``[M]``."""
        angle = self._bearing.step(numbers) * ~crossing
        cos, sin = np.cos(angle), np.sin(angle)
        return np.stack([cos * way[:, 0] - sin * way[:, 1], sin * way[:, 0] + cos * way[:, 1]], axis=1)


def _among(groups: Ints, chosen: dict[int, float]) -> Bools:
    return np.array([group in chosen for group in groups.tolist()], dtype=np.bool_)
