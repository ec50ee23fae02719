"""Ways of people along sidewalks and over crossings, and the forces on them.

Social forces: Helbing and Molnár (1995), "Social force model for pedestrian dynamics",
with a pull towards the group as in Moussaïd et al. (2010), "The walking behaviour of
pedestrian social groups". People are always at least `APART_M` from each other, so that
their boxes do not overlap.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core import Bools, Floats
from .road_map import Crossing, Pavement
from .world import STRIP_M

APART_M = 0.8  # between two centres
# from the middle of the junction, where people come from and go to
_END_M = (62.0, 70.0)
# from the kerb, for people who come and people who go
_COMING_M = (0.9, 1.6)
_GOING_M = (2.7, 3.4)
# share of the people who come along the road that they do not cross
_AROUND_SHARE = 0.8
# between two people of a group
_BESIDE_M = 0.9
_BEHIND_M = 0.95
_SIDEWALK_EDGE_M = 0.35  # from the kerb, within which people on a sidewalk stay
_CORNER_CLEARANCE_M = 6.0  # from the corner to the first parked car
_KERB_BRAKING_MPS2 = 2.0  # of people before a kerb
_RELAXATION_S = 0.5
_PUSH_MPS2 = 2.1
_PUSH_RANGE_M = 0.35
_SIGHT_M = 3.0
_REAR_PUSH = 0.35  # share of the push from people behind
_FRIEND_PUSH = 0.3  # share of the push from people of the same group
_PULL = 0.5  # 1/s2 towards the middle of a group that is far away
_MIN_PULL_M = 1.3
_SLOWING_S = 0.8  # to the goal, where people slow down
# to the outline of a vehicle, where people do not go, and where they stop
_OUTLINE_M = 0.42
_STOP_M = 0.65
_BRAKING_MPS2 = 2.5  # of people before each other and before vehicles
_MAX_FORCE_MPS2 = 3.0
_TINY = 1e-9
Pairs = tuple[Floats, Floats, Floats]  # as `pairs_of`


@dataclass(frozen=True)
class SidewalkUse:
    """Sidewalk of a group before or after its crossing."""

    around: bool  # beside the other road of the corner instead of the crossed one
    far: float  # m from the middle of the junction to its end
    kerb: float  # m from the kerb


def draw_sidewalk(coming: bool, rng: np.random.Generator) -> SidewalkUse:
    """Draw one of the two sidewalks of a corner.

    Arriving and leaving people keep apart.
    """
    kerb = STRIP_M + rng.uniform(*(_COMING_M if coming else _GOING_M))
    around = bool(rng.uniform() < _AROUND_SHARE)
    return SidewalkUse(around, float(rng.uniform(*_END_M)), float(kerb))


@dataclass(frozen=True, eq=False)
class Footway:
    """Way of a group.

    Points are (along the crossing, across it and outwards) in metres from its origin.
    """

    crossing: Crossing
    pavement: Pavement
    direction: float
    middle: float  # m across the crossing
    coming: SidewalkUse
    going: SidewalkUse

    def waiting_point(self, k: int) -> Floats:
        """Return the point where the k-th person waits: two by two."""
        behind = 0.9 + _BEHIND_M * (k // 2)
        along = self._kerb(-1) - self.direction * behind
        return np.array([along, self.middle + _BESIDE_M * (k % 2)])

    def far_point(self, k: int) -> Floats:
        """Return the point where the k-th person leaves the road."""
        along = self._kerb(1) + self.direction * 0.6
        return np.array([along, self.waiting_point(k)[1]])

    def arrival(self, k: int) -> list[Floats]:
        """Return points of the k-th person's way to the crossing."""
        return [*self._along(self.coming, -1, k), self.waiting_point(k)]

    def departure(self, k: int) -> list[Floats]:
        """Return points of the k-th person's way from the road."""
        return [self.far_point(k), *reversed(self._along(self.going, 1, k))]

    def stroll(self, k: int) -> list[Floats]:
        """Return points of the k-th person's way without a crossing.

        It is along one road, around the corner and along the other.
        """
        other = replace(self.coming, around=not self.coming.around)
        return [*self._along(self.coming, -1, k), *reversed(self._along(other, -1, k))]

    def _kerb(self, end: int) -> float:
        return self.crossing.span if end * self.direction > 0 else 0.0

    def _along(self, sidewalk: SidewalkUse, end: int, k: int) -> list[Floats]:
        """Return the two ends of a sidewalk, the far one first."""
        kerb = self.pavement.kerb
        x, y = self.crossing.origin
        # m from the junction's middle
        out = float(np.hypot(x, y) ** 2 - kerb**2) ** 0.5
        aside = sidewalk.kerb + _BESIDE_M * (k % 2)
        far = sidewalk.far + _BEHIND_M * (k // 2)
        away = end * self.direction
        if sidewalk.around:
            places = (far, self.pavement.corner + 1.0)
            points = [(away * (place - kerb), kerb + aside - out) for place in places]
        else:
            places = (far, self.pavement.corner + _CORNER_CLEARANCE_M)
            points = [(away * aside, place - out) for place in places]
        return [np.array([self._kerb(end) + along, across]) for along, across in points]


def remaining_way(points: list[Floats], share: float) -> list[Floats]:
    """Return the last ``share`` of a way.

    The first point is its start.
    """
    steps = [float(np.hypot(*(b - a))) for a, b in pairwise(points)]
    passed = (1.0 - share) * sum(steps)
    k = 0
    while k + 1 < len(steps) and passed > steps[k]:
        passed -= steps[k]
        k += 1
    step_share = min(passed / steps[k], 1.0)
    start = points[k] + (points[k + 1] - points[k]) * step_share
    return [start, *points[k + 1 :]]


def slow_at_kerb(
    place: Floats, velocity: Floats, pavement: Pavement, on_sidewalk: Bools
) -> Floats:
    """Return velocities [2, M] at which people can stop before the kerb.

    Only people ``on_sidewalk`` [M] change theirs.
    """
    outwards, room = _to_kerb(place, pavement)
    allowed = np.sqrt(2.0 * _KERB_BRAKING_MPS2 * np.maximum(room, 0.0))
    excess = np.maximum(_dot(velocity, outwards) - allowed, 0.0) * on_sidewalk
    return velocity - excess * outwards


def keep_off_road(place: Floats, pavement: Pavement, on_sidewalk: Bools) -> Floats:
    """Return places [2, M] off the road.

    People ``on_sidewalk`` [M] are moved back to it.
    """
    outwards, room = _to_kerb(place, pavement)
    return place - np.maximum(-room, 0.0) * on_sidewalk * outwards


def _to_kerb(place: Floats, pavement: Pavement) -> tuple[Floats, Floats]:
    """Return direction [2, M] and distance [M] to the kerb.

    The distance is negative on the road.
    """
    excess = np.maximum(pavement.corner - np.abs(place), 0.0)
    distance = np.hypot(*excess)
    outwards = -np.where(place < 0, -1.0, 1.0) * excess / np.maximum(distance, _TINY)
    return outwards, pavement.radius - _SIDEWALK_EDGE_M - distance


def social_force(
    pairs: Pairs, velocity: Floats, to_goal: Floats, pace: Floats, friends: Bools
) -> Floats:
    """Return accelerations [2, M], m/s2, of people on foot.

    ``pairs``: of their places; ``velocity`` [2, M] m/s; ``to_goal`` [2, M]: vector to
    the goal; ``pace`` [M]: desired speed; ``friends`` [M, M]: others of the same group.
    """
    goal_m = np.hypot(*to_goal)
    speed = np.minimum(pace, goal_m / _SLOWING_S)
    desired = to_goal / np.maximum(goal_m, _TINY) * speed
    between, gap, unit = pairs
    ahead = desired / np.maximum(np.hypot(*desired), _TINY)
    facing = -_dot(ahead, unit)
    strength = _PUSH_MPS2 * np.exp((APART_M - gap) / _PUSH_RANGE_M) * (gap < _SIGHT_M)
    strength = strength * np.where(friends, _FRIEND_PUSH, 1.0)
    strength *= _REAR_PUSH + (1 - _REAR_PUSH) * (1 + facing) / 2
    push = (strength * unit).sum(axis=1)
    # of the group
    to_middle = -(between * friends).sum(axis=1) / np.maximum(friends.sum(axis=0), 1)
    pull = to_middle * np.where(np.hypot(*to_middle) > _MIN_PULL_M, _PULL, 0.0)
    force = (desired - velocity) / _RELAXATION_S + push + pull
    return limit_length(force, _MAX_FORCE_MPS2)


def pairs_of(place: Floats) -> Pairs:
    """Return vectors [2, M, M] from others to each person (last axis).

    Beside them lengths [M, M], inf to oneself, and unit vectors [2, M, M].
    """
    between = place[:, None, :] - place[:, :, None]
    gap = np.hypot(*between)
    unit = between / np.maximum(gap, _TINY)  # 0 to oneself
    np.fill_diagonal(gap, np.inf)
    return between, gap, unit


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def limit_length(vector: Floats, limit: Floats | float) -> Floats:
    """Return vectors [2, M] shortened to at most ``limit``."""
    share = np.minimum(1.0, limit / np.maximum(np.hypot(*vector), _TINY))
    return np.asarray(vector * share)


def slow_before_others(
    place: Floats, pairs: Pairs, velocity: Floats, vehicles: "Outlines", dt: float
) -> Floats:
    """Return velocities [2, M] at which people can stop in time.

    They stop before each other and before ``vehicles``; ``pairs``: of ``place``.
    """
    _, gap, unit = pairs
    approach = -_dot(velocity, unit)  # speed
    allowed = np.sqrt(2.0 * _BRAKING_MPS2 * np.maximum(gap - APART_M, 0.0))
    excess = np.maximum(approach + approach.T - allowed, 0.0)
    closing = np.maximum(approach, 0.0)
    excess *= closing / np.maximum(closing + closing.T, _TINY)
    worst = excess.argmax(axis=0)
    people = np.arange(len(gap))
    velocity = velocity + excess[worst, people] * unit[:, worst, people]
    clearance = vehicles.before
    coming = (clearance - vehicles.clearance(place + dt * velocity)) / dt
    allowed = np.sqrt(2.0 * _BRAKING_MPS2 * np.maximum(clearance - _STOP_M, 0.0))
    share = np.where(coming > allowed, allowed / np.maximum(coming, _TINY), 1.0)
    return np.asarray(velocity * share.min(axis=1, initial=1.0))


def push_apart(place: Floats) -> Floats:
    """Return places [2, M] after people closer than `APART_M` are moved apart."""
    for _ in range(3):
        between = place[:, None, :] - place[:, :, None]
        gap = np.hypot(*between)
        short = np.maximum(APART_M + 1e-3 - gap, 0.0)
        np.fill_diagonal(short, 0.0)  # to oneself
        if not short.any():
            break
        place = place + 0.5 * (short * (between / np.maximum(gap, 1e-6))).sum(axis=1)
    return place


def keep_out_of_vehicles(place: Floats, moved: Floats, vehicles: "Outlines") -> Floats:
    """Return places [2, M] outside of vehicles.

    They are ``moved``, but people in front of a vehicle stay at ``place``.
    """
    clearance = vehicles.clearance(moved)
    too_near = (clearance < _OUTLINE_M) & (clearance < vehicles.before)
    return np.where(too_near.any(axis=1), place, moved)


class Outlines:
    """Outlines of boxes [N, 7].

    ``before`` [M, N]: their clearance of people at ``place`` [2, M], who move then.
    """

    def __init__(self, box: Floats, place: Floats) -> None:
        self._center = box[:, :2].T
        self._half_length = box[:, 4] / 2
        self._half_width = box[:, 5] / 2
        self._cos = np.cos(box[:, 3])
        self._sin = np.sin(box[:, 3])
        self.before = self.clearance(place)

    def clearance(self, points: Floats) -> Floats:
        """Return distances [M, N] of points [2, M] to the outlines.

        They are along the axes of the boxes, and negative inside.
        """
        dx, dy = points[:, :, None] - self._center[:, None]
        along = np.abs(self._cos * dx + self._sin * dy) - self._half_length
        across = np.abs(self._cos * dy - self._sin * dx) - self._half_width
        return np.asarray(np.maximum(along, across))
