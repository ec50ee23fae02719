"""Walking: the ways of people along sidewalks and over crossings, and the forces between people and vehicles.

Social forces: Helbing and Molnár (1995), "Social force model for pedestrian dynamics", with a pull towards the group as
in Moussaïd et al. (2010), "The walking behaviour of pedestrian social groups". People are always at least `APART` from
each other, so that their boxes do not overlap.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core import Bools, Floats
from .networks import Crossing, Pavement
from .world import STRAIGHT_ON, STRIP

APART = 0.8  # m between two centres
_FAR = (
    62.0,
    70.0,
)  # m from the middle of the junction, where people come from and go to
_COMING, _GOING = (
    (0.9, 1.6),
    (2.7, 3.4),
)  # m from the kerb, for people who come and people who go
_BESIDE, _BEHIND = 0.9, 0.95  # m between two people of a group
_SIDEWALK_EDGE = 0.35  # m from the kerb, within which people on a sidewalk stay
_CLEAR = 6.0  # m from the corner to the first parked car
_EASY_AT_KERB = 2.0  # m/s2, braking of people before a kerb
_RELAX = 0.5  # s
_PUSH, _RANGE, _SIGHT = 2.1, 0.35, 3.0  # m/s2, m, m
_BLIND = 0.35  # share of the push from people behind
_FRIEND = 0.3  # share of the push from people of the same group
_PULL, _TOGETHER = (
    0.5,
    1.3,
)  # 1/s2 towards the middle of a group that is farther away than this, m
_SLOWING = 0.8  # s to the goal, where people slow down
_FROM_BOX = 0.42  # m to the outline of a vehicle, where people do not go
_ROOM = 0.65  # m to it, where people stop
_EASY = 2.5  # m/s2, braking of people before each other and before vehicles
_STRONGEST = 3.0  # m/s2 of force
_TINY = 1e-9
Pairs = tuple[Floats, Floats, Floats]  # as `pairs_of`


@dataclass(frozen=True)
class SidewalkUse:
    """Sidewalk of a group before or after its crossing."""

    around: bool  # beside the other road of the corner instead of the crossed one
    far: float  # m from the middle of the junction to its end
    kerb: float  # m from the kerb


def draw_sidewalk(coming: bool, rng: np.random.Generator) -> SidewalkUse:
    """Draw one of the two sidewalks of a corner; arriving and leaving people keep apart."""
    kerb = STRIP + rng.uniform(*(_COMING if coming else _GOING))
    return SidewalkUse(
        bool(rng.uniform() < STRAIGHT_ON), float(rng.uniform(*_FAR)), float(kerb)
    )


@dataclass(frozen=True, eq=False)
class Footway:
    """Way of a group; points are (along the crossing, across it and outwards) in metres from its origin."""

    crossing: Crossing
    pavement: Pavement
    direction: float
    middle: float  # m across the crossing
    coming: SidewalkUse
    going: SidewalkUse

    def waiting_point(self, k: int) -> Floats:
        """Point where the k-th person waits: two by two."""
        along = self._kerb(-1) - self.direction * (0.9 + _BEHIND * (k // 2))
        return np.array([along, self.middle + _BESIDE * (k % 2)])

    def far_point(self, k: int) -> Floats:
        """Point where the k-th person leaves the road."""
        return np.array(
            [self._kerb(1) + self.direction * 0.6, self.waiting_point(k)[1]]
        )

    def arrival(self, k: int) -> list[Floats]:
        """Points of the k-th person's way to the crossing."""
        return [*self._along(self.coming, -1, k), self.waiting_point(k)]

    def departure(self, k: int) -> list[Floats]:
        """Points of the k-th person's way from the other side of the road."""
        return [self.far_point(k), *reversed(self._along(self.going, 1, k))]

    def stroll(self, k: int) -> list[Floats]:
        """Points of the k-th person's way without a crossing: along one road, around the corner, along the other."""
        other = replace(self.coming, around=not self.coming.around)
        return [*self._along(self.coming, -1, k), *reversed(self._along(other, -1, k))]

    def _kerb(self, end: int) -> float:
        return self.crossing.span if end * self.direction > 0 else 0.0

    def _along(self, sidewalk: SidewalkUse, end: int, k: int) -> list[Floats]:
        x, y = self.crossing.origin
        out = (
            float(np.hypot(x, y) ** 2 - self.pavement.kerb**2) ** 0.5
        )  # m from the junction's middle
        aside, far = (
            sidewalk.kerb + _BESIDE * (k % 2),
            sidewalk.far + _BEHIND * (k // 2),
        )
        away = end * self.direction
        if not sidewalk.around:
            ends = far, self.pavement.corner + _CLEAR
            return [
                np.array([self._kerb(end) + away * aside, place - out])
                for place in ends
            ]
        across = self.pavement.kerb + aside - out
        places = (far, self.pavement.corner + 1.0)
        return [
            np.array([self._kerb(end) + away * (place - self.pavement.kerb), across])
            for place in places
        ]


def remaining_way(points: list[Floats], share: float) -> list[Floats]:
    """The last ``share`` of a way; the first point is its start."""
    steps = [float(np.hypot(*(b - a))) for a, b in pairwise(points)]
    done = (1.0 - share) * sum(steps)
    k = 0
    while k + 1 < len(steps) and done > steps[k]:
        done -= steps[k]
        k += 1
    return [
        points[k] + (points[k + 1] - points[k]) * min(done / steps[k], 1.0),
        *points[k + 1 :],
    ]


def slow_at_kerb(
    place: Floats, velocity: Floats, pavement: Pavement, on_sidewalk: Bools
) -> Floats:
    """Velocities ``[2, M]`` at which people ``on_sidewalk`` ``[M]`` can stop before the kerb."""
    outwards, room = _to_kerb(place, pavement)
    towards = _dot(velocity, outwards)
    excess = (
        np.maximum(towards - np.sqrt(2.0 * _EASY_AT_KERB * np.maximum(room, 0.0)), 0.0)
        * on_sidewalk
    )
    return velocity - excess * outwards


def keep_off_road(place: Floats, pavement: Pavement, on_sidewalk: Bools) -> Floats:
    """Places ``[2, M]``; people ``on_sidewalk`` ``[M]`` are moved back to it."""
    outwards, room = _to_kerb(place, pavement)
    return place - np.maximum(-room, 0.0) * on_sidewalk * outwards


def _to_kerb(place: Floats, pavement: Pavement) -> tuple[Floats, Floats]:
    """Direction to the nearest kerb ``[2, M]``, and the distance to it ``[M]``, negative on the road."""
    excess = np.maximum(pavement.corner - np.abs(place), 0.0)
    distance = np.hypot(*excess)
    outwards = -np.where(place < 0, -1.0, 1.0) * excess / np.maximum(distance, 1e-9)
    return outwards, pavement.radius - _SIDEWALK_EDGE - distance


def social_force(
    pairs: Pairs, velocity: Floats, to_goal: Floats, pace: Floats, friends: Bools
) -> Floats:
    """Acceleration ``[2, M]``, m/s2, of people on foot.

    ``pairs``: of their places, ``velocity`` ``[2, M]`` m/s, ``to_goal`` ``[2, M]`` vector to the goal, ``pace`` ``[M]``
    desired speed, ``friends`` ``[M, M]``: others of the same group.
    """
    far = np.hypot(*to_goal)
    wanted = to_goal / np.maximum(far, _TINY) * np.minimum(pace, far / _SLOWING)
    between, gap, unit = pairs
    ahead = wanted / np.maximum(np.hypot(*wanted), _TINY)
    facing = -_dot(ahead, unit)
    strength = (
        _PUSH
        * np.exp((APART - gap) / _RANGE)
        * (gap < _SIGHT)
        * np.where(friends, _FRIEND, 1.0)
    )
    strength *= _BLIND + (1 - _BLIND) * (1 + facing) / 2
    push = (strength * unit).sum(axis=1)
    to_middle = -(between * friends).sum(axis=1) / np.maximum(
        friends.sum(axis=0), 1
    )  # of the group
    pull = to_middle * np.where(np.hypot(*to_middle) > _TOGETHER, _PULL, 0.0)
    force = (wanted - velocity) / _RELAX + push + pull
    return limit_length(force, _STRONGEST)


def pairs_of(place: Floats) -> Pairs:
    """Vectors ``[2, M, M]`` from the others to each person (last axis), lengths (inf to oneself), and unit vectors."""
    between = place[:, None, :] - place[:, :, None]
    gap = np.hypot(*between)
    unit = between / np.maximum(gap, _TINY)  # 0 to oneself
    gap.reshape(-1)[:: len(gap) + 1] = np.inf
    return between, gap, unit


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def limit_length(vector: Floats, most: Floats | float) -> Floats:
    """Vectors ``[2, M]`` shortened to at most ``most``."""
    return np.asarray(
        vector * np.minimum(1.0, most / np.maximum(np.hypot(*vector), _TINY))
    )


def slow_before_others(
    place: Floats, pairs: Pairs, velocity: Floats, vehicles: "Outlines", dt: float
) -> Floats:
    """Velocities ``[2, M]`` at which people can stop before each other and ``vehicles``; ``pairs``: of ``place``."""
    _, gap, unit = pairs
    own = -_dot(velocity, unit)  # approaching speed
    allowed = np.sqrt(2.0 * _EASY * np.maximum(gap - APART, 0.0))
    excess = np.maximum(own + own.T - allowed, 0.0)
    closing = np.maximum(own, 0.0)
    excess *= closing / np.maximum(closing + closing.T, _TINY)
    worst, people = excess.argmax(axis=0), np.arange(len(gap))
    velocity = velocity + excess[worst, people] * unit[:, worst, people]
    before = vehicles.before
    coming = (before - vehicles.clearance(place + dt * velocity)) / dt
    allowed = np.sqrt(2.0 * _EASY * np.maximum(before - _ROOM, 0.0))
    share = np.where(coming > allowed, allowed / np.maximum(coming, _TINY), 1.0).min(
        axis=1, initial=1.0
    )
    return np.asarray(velocity * share)


def push_apart(place: Floats) -> Floats:
    """Places ``[2, M]`` after people closer than `APART` are moved apart."""
    for _ in range(3):
        between = place[:, None, :] - place[:, :, None]
        gap = np.hypot(*between)
        short = np.maximum(APART + 1e-3 - gap, 0.0)
        short.reshape(-1)[:: len(gap) + 1] = 0.0  # to oneself
        if not short.any():
            break
        place = place + 0.5 * (short * (between / np.maximum(gap, 1e-6))).sum(axis=1)
    return place


def keep_out_of_vehicles(place: Floats, moved: Floats, vehicles: "Outlines") -> Floats:
    """``moved`` ``[2, M]``; people in front of a vehicle stay at ``place``."""
    after = vehicles.clearance(moved)
    return np.where(
        np.any((after < _FROM_BOX) & (after < vehicles.before), axis=1), place, moved
    )


class Outlines:
    """Outlines of boxes ``[N, 7]``, and their clearance ``[M, N]`` ``before`` people at ``place`` ``[2, M]`` move."""

    def __init__(self, box: Floats, place: Floats) -> None:
        self._x, self._y, self._half_length, self._half_width = (
            box[:, 0],
            box[:, 1],
            box[:, 4] / 2,
            box[:, 5] / 2,
        )
        self._cos, self._sin = np.cos(box[:, 3]), np.sin(box[:, 3])
        self.before = self.clearance(place)

    def clearance(self, points: Floats) -> Floats:
        """Distance ``[M, N]`` of points ``[2, M]`` to the outlines along the axes of the boxes; negative inside."""
        dx, dy = points[0, :, None] - self._x, points[1, :, None] - self._y
        along = np.abs(self._cos * dx + self._sin * dy) - self._half_length
        across = np.abs(self._cos * dy - self._sin * dx) - self._half_width
        return np.maximum(along, across)
