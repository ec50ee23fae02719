"""The ways of people on foot: along a sidewalk to a crossing, over it, and along a sidewalk away from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...types import Bools, Floats
from . import plans
from .networks import Crossing, Pavement

_FAR = (62.0, 70.0)  # m from the middle of the junction, where people come from and go to
_COMING, _GOING = (0.9, 1.6), (2.7, 3.4)  # m from the kerb, of those who come and of those who go
_BESIDE, _BEHIND = 0.9, 0.95  # m between two of a group
_WALKED = 0.35  # m from the kerb that nobody on a sidewalk leaves
_CLEAR = 6.0  # m from the corner, where cars do not park yet
_EASY = 2.0  # m/s2, how people slow down before a kerb


@dataclass(frozen=True)
class Side:
    """A sidewalk as a group uses it."""

    around: bool  # beside the other road of the corner, not beside the one that is crossed
    far: float  # m from the middle of the junction to its end
    kerb: float  # m from the kerb


def draw_side(coming: bool, rng: np.random.Generator) -> Side:
    """One of the two sidewalks of a corner, behind the parked cars; who comes and who goes keep apart."""
    kerb = plans.STRIP + rng.uniform(*(_COMING if coming else _GOING))
    return Side(bool(rng.uniform() < plans.STRAIGHT_ON), float(rng.uniform(*_FAR)), float(kerb))


@dataclass(frozen=True, eq=False)
class Footway:
    """The way of a group; places are (along the crossing, across it and outwards) in metres from its origin."""

    crossing: Crossing
    pavement: Pavement
    direction: float
    middle: float  # m across the crossing
    coming: Side
    going: Side

    def slot(self, k: int) -> Floats:
        """Where the k-th of them waits: two by two."""
        return np.array([self._kerb(-1) - self.direction * (0.9 + _BEHIND * (k // 2)), self.middle + _BESIDE * (k % 2)])

    def beyond(self, k: int) -> Floats:
        """Where the k-th leaves the road."""
        return np.array([self._kerb(1) + self.direction * 0.6, self.slot(k)[1]])

    def arrival(self, k: int) -> list[Floats]:
        """Where the k-th comes from, the corner if it goes around one, and the slot."""
        return [*self._along(self.coming, -1, k), self.slot(k)]

    def departure(self, k: int) -> list[Floats]:
        """The other side of the road, the corner if the k-th goes around one, and where it goes to."""
        return [self.beyond(k), *reversed(self._along(self.going, 1, k))]

    def stroll(self, k: int) -> list[Floats]:
        """The way of the k-th of those who do not cross: along one road, around the corner and along the other."""
        other = replace(self.coming, around=not self.coming.around)
        return [*self._along(self.coming, -1, k), *reversed(self._along(other, -1, k))]

    def _kerb(self, end: int) -> float:
        return self.crossing.span if end * self.direction > 0 else 0.0

    def _along(self, side: Side, end: int, k: int) -> list[Floats]:
        x, y = self.crossing.origin
        out = float(np.hypot(x, y) ** 2 - self.pavement.kerb**2) ** 0.5  # m from the junction's middle
        aside, far = side.kerb + _BESIDE * (k % 2), side.far + _BEHIND * (k // 2)
        away = end * self.direction
        if not side.around:
            ends = far, self.pavement.corner + _CLEAR
            return [np.array([self._kerb(end) + away * aside, place - out]) for place in ends]
        across = self.pavement.kerb + aside - out
        places = (far, self.pavement.corner + 1.0)
        return [np.array([self._kerb(end) + away * (place - self.pavement.kerb), across]) for place in places]


def cut(points: list[Floats], share: float) -> list[Floats]:
    """What is left of a way when ``share`` of its length is still to go; the first point is where that begins."""
    steps = [float(np.hypot(*(b - a))) for a, b in pairwise(points)]
    gone = (1.0 - share) * sum(steps)
    k = 0
    while k + 1 < len(steps) and gone > steps[k]:
        gone -= steps[k]
        k += 1
    return [points[k] + (points[k + 1] - points[k]) * min(gone / steps[k], 1.0), *points[k + 1 :]]


def slowed_at_kerb(place: Floats, velocity: Floats, pavement: Pavement, on_sidewalk: Bools) -> Floats:
    """Velocities ``[M, 2]`` at which people ``on_sidewalk`` ``[M]`` can stop before the kerb."""
    outwards, room = _kerb(place, pavement)
    towards = (velocity * outwards).sum(axis=1)
    excess = np.maximum(towards - np.sqrt(2.0 * _EASY * np.maximum(room, 0.0)), 0.0) * on_sidewalk
    return np.asarray(velocity - excess[:, None] * outwards)


def kept_off_road(place: Floats, pavement: Pavement, on_sidewalk: Bools) -> Floats:
    """Places ``[M, 2]`` with those ``on_sidewalk`` ``[M]`` brought back to it."""
    outwards, room = _kerb(place, pavement)
    back = np.maximum(-room, 0.0) * on_sidewalk
    return place - back[:, None] * outwards


def _kerb(place: Floats, pavement: Pavement) -> tuple[Floats, Floats]:
    """Direction to the nearest kerb ``[M, 2]`` and the way left to it ``[M]``, negative on the road."""
    excess = np.maximum(pavement.corner - np.abs(place), 0.0)
    distance = np.hypot(excess[:, 0], excess[:, 1])
    outwards = -np.where(place < 0, -1.0, 1.0) * excess / np.maximum(distance, 1e-9)[:, None]
    return outwards, pavement.radius - _WALKED - distance
