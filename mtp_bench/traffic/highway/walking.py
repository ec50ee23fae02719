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
from .lanes import Crossing, Pavement
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
_WAITING_M = 0.9  # from the kerb to the first people of a group that waits
_BEYOND_KERB_M = 0.6  # to the point where people have left the road
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
_MIN_DIVISOR = 1e-9
Pairs = tuple[Floats, Floats, Floats]  # as `pairs_of`


@dataclass(frozen=True)
class SidewalkUse:
    """Sidewalk of a group before or after its crossing."""

    around: bool  # beside the other road of the corner instead of the crossed one
    end_m: float  # m from the middle of the junction to its end
    kerb: float  # m from the kerb


def draw_sidewalk(coming: bool, rng: np.random.Generator) -> SidewalkUse:
    """Draw one of the two sidewalks of a corner.

    People who come (``coming``) and people who leave keep apart.
    """
    kerb_m = STRIP_M + rng.uniform(*(_COMING_M if coming else _GOING_M))
    around = bool(rng.uniform() < _AROUND_SHARE)
    return SidewalkUse(around, float(rng.uniform(*_END_M)), float(kerb_m))


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

    def waiting_point(self, member_index: int) -> Floats:
        """Return the point where person ``member_index`` waits: two by two."""
        behind = _WAITING_M + _BEHIND_M * (member_index // 2)
        along = self._kerb(-1) - self.direction * behind
        return np.array([along, self.middle + _BESIDE_M * (member_index % 2)])

    def far_point(self, member_index: int) -> Floats:
        """Return the point where person ``member_index`` leaves the road."""
        along = self._kerb(1) + self.direction * _BEYOND_KERB_M
        return np.array([along, self.waiting_point(member_index)[1]])

    def arrival(self, member_index: int) -> list[Floats]:
        """Return points of the way of person ``member_index`` to the crossing."""
        return [
            *self._along(self.coming, -1, member_index),
            self.waiting_point(member_index),
        ]

    def departure(self, member_index: int) -> list[Floats]:
        """Return points of the way of person ``member_index`` from the road."""
        return [
            self.far_point(member_index),
            *reversed(self._along(self.going, 1, member_index)),
        ]

    def stroll(self, member_index: int) -> list[Floats]:
        """Return points of the way of person ``member_index`` without a crossing.

        The way leads along one road, around the corner and along the other road.
        """
        other_road = replace(self.coming, around=not self.coming.around)
        return [
            *self._along(self.coming, -1, member_index),
            *reversed(self._along(other_road, -1, member_index)),
        ]

    def _kerb(self, end: int) -> float:
        """Return m along the crossing to a kerb.

        ``end``: -1 for the kerb that people come to, 1 for the other one.
        """
        return self.crossing.span if end * self.direction > 0 else 0.0

    def _along(
        self, sidewalk: SidewalkUse, end: int, member_index: int
    ) -> list[Floats]:
        """Return the two ends of a sidewalk, the far one first.

        ``end`` as in `_kerb`.
        """
        kerb_m = self.pavement.kerb
        x, y = self.crossing.origin
        # m from the junction's middle
        junction_m = float(np.hypot(x, y) ** 2 - kerb_m**2) ** 0.5
        aside_m = sidewalk.kerb + _BESIDE_M * (member_index % 2)
        far_m = sidewalk.end_m + _BEHIND_M * (member_index // 2)
        outward = end * self.direction
        if sidewalk.around:
            places = (far_m, self.pavement.corner + 1.0)
            points = [
                (outward * (place - kerb_m), kerb_m + aside_m - junction_m)
                for place in places
            ]
        else:
            places = (far_m, self.pavement.corner + _CORNER_CLEARANCE_M)
            points = [(outward * aside_m, place - junction_m) for place in places]
        return [np.array([self._kerb(end) + along, across]) for along, across in points]


def remaining_way(points: list[Floats], remaining_share: float) -> list[Floats]:
    """Return the points of the last ``remaining_share`` of a way.

    The first point is where this part begins.
    """
    step_lengths = [float(np.hypot(*(b - a))) for a, b in pairwise(points)]
    passed_m = (1.0 - remaining_share) * sum(step_lengths)
    step = 0
    while step + 1 < len(step_lengths) and passed_m > step_lengths[step]:
        passed_m -= step_lengths[step]
        step += 1
    step_share = min(passed_m / step_lengths[step], 1.0)
    start = points[step] + (points[step + 1] - points[step]) * step_share
    return [start, *points[step + 1 :]]


def slow_at_kerb(
    place: Floats, velocity: Floats, pavement: Pavement, on_sidewalk: Bools
) -> Floats:
    """Return velocities [2, M] at which people can stop before the kerb.

    Only people ``on_sidewalk`` [M] change theirs.
    """
    outwards, room_m = _to_kerb(place, pavement)
    allowed_mps = np.sqrt(2.0 * _KERB_BRAKING_MPS2 * np.maximum(room_m, 0.0))
    excess_mps = np.maximum(_dot(velocity, outwards) - allowed_mps, 0.0) * on_sidewalk
    return velocity - excess_mps * outwards


def keep_off_road(place: Floats, pavement: Pavement, on_sidewalk: Bools) -> Floats:
    """Return places [2, M] off the road.

    People ``on_sidewalk`` [M] are moved back to it.
    """
    outwards, room_m = _to_kerb(place, pavement)
    return place - np.maximum(-room_m, 0.0) * on_sidewalk * outwards


def _to_kerb(place: Floats, pavement: Pavement) -> tuple[Floats, Floats]:
    """Return direction [2, M] and distance [M] to the kerb.

    The distance is negative on the road.
    """
    # [2, M] from the middle of the bend of the kerb
    offset_m = np.maximum(pavement.corner - np.abs(place), 0.0)
    distance = np.hypot(*offset_m)
    sign = -np.where(place < 0, -1.0, 1.0)
    outwards = sign * offset_m / np.maximum(distance, _MIN_DIVISOR)
    return outwards, pavement.radius - _SIDEWALK_EDGE_M - distance


def social_force(
    pairs: Pairs, velocity: Floats, to_goal: Floats, pace: Floats, friends: Bools
) -> Floats:
    """Return accelerations [2, M], m/s2, of people on foot.

    ``pairs``: `pairs_of` their places; ``velocity`` [2, M] m/s; ``to_goal`` [2, M]:
    vector to the goal; ``pace`` [M]: desired speed; ``friends`` [M, M]: others of the
    same group.
    """
    goal_m = np.hypot(*to_goal)
    desired_mps = np.minimum(pace, goal_m / _SLOWING_S)
    desired_velocity = to_goal / np.maximum(goal_m, _MIN_DIVISOR) * desired_mps
    between_vectors, gap_m, unit = pairs
    ahead = desired_velocity / np.maximum(np.hypot(*desired_velocity), _MIN_DIVISOR)
    facing_cosine = -_dot(ahead, unit)
    push_strength = (
        _PUSH_MPS2 * np.exp((APART_M - gap_m) / _PUSH_RANGE_M) * (gap_m < _SIGHT_M)
    )
    push_strength = push_strength * np.where(friends, _FRIEND_PUSH, 1.0)
    push_strength *= _REAR_PUSH + (1 - _REAR_PUSH) * (1 + facing_cosine) / 2
    push_force = (push_strength * unit).sum(axis=1)
    # vector to the middle of the group
    to_middle = -(between_vectors * friends).sum(axis=1) / np.maximum(
        friends.sum(axis=0), 1
    )
    pull_force = to_middle * np.where(np.hypot(*to_middle) > _MIN_PULL_M, _PULL, 0.0)
    force = (desired_velocity - velocity) / _RELAXATION_S + push_force + pull_force
    return limit_length(force, _MAX_FORCE_MPS2)


def pairs_of(place: Floats) -> Pairs:
    """Return vectors, lengths and unit vectors from others to each person.

    Vectors [2, M, M] and unit vectors [2, M, M] have the person on the last axis. A
    length [M, M] is inf from a person to itself.
    """
    between_vectors = place[:, None, :] - place[:, :, None]
    gap_m = np.hypot(*between_vectors)
    unit = between_vectors / np.maximum(gap_m, _MIN_DIVISOR)  # 0 to oneself
    np.fill_diagonal(gap_m, np.inf)
    return between_vectors, gap_m, unit


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def limit_length(vector: Floats, limit: Floats | float) -> Floats:
    """Return vectors [2, M] shortened to at most ``limit``."""
    kept_share = np.minimum(1.0, limit / np.maximum(np.hypot(*vector), _MIN_DIVISOR))
    return np.asarray(vector * kept_share)


def slow_before_others(
    place: Floats, pairs: Pairs, velocity: Floats, vehicles: "Outlines", step_s: float
) -> Floats:
    """Return velocities [2, M] at which people can stop in time.

    They stop before each other and before ``vehicles``. ``pairs`` are those that
    `pairs_of` returns for ``place``.
    """
    _, gap_m, unit = pairs
    approach_mps = -_dot(velocity, unit)  # [M, M] of the last axis towards others
    allowed_mps = np.sqrt(2.0 * _BRAKING_MPS2 * np.maximum(gap_m - APART_M, 0.0))
    # of both people together
    excess_mps = np.maximum(approach_mps + approach_mps.T - allowed_mps, 0.0)
    closing_mps = np.maximum(approach_mps, 0.0)
    # each of two people slows down in proportion to its part of their closing speed
    excess_mps *= closing_mps / np.maximum(closing_mps + closing_mps.T, _MIN_DIVISOR)
    # a person slows down for one other person: the one it closes in on most
    worst = excess_mps.argmax(axis=0)
    people = np.arange(len(gap_m))
    velocity = velocity + excess_mps[worst, people] * unit[:, worst, people]
    clearance = vehicles.before
    coming_mps = (clearance - vehicles.clearance(place + step_s * velocity)) / step_s
    allowed_mps = np.sqrt(2.0 * _BRAKING_MPS2 * np.maximum(clearance - _STOP_M, 0.0))
    kept_share = np.where(
        coming_mps > allowed_mps,
        allowed_mps / np.maximum(coming_mps, _MIN_DIVISOR),
        1.0,
    )
    return np.asarray(velocity * kept_share.min(axis=1, initial=1.0))


def push_apart(place: Floats) -> Floats:
    """Return places [2, M] after people closer than `APART_M` are moved apart."""
    for _ in range(3):  # one push may bring a person close to a third one
        between_vectors = place[:, None, :] - place[:, :, None]
        gap_m = np.hypot(*between_vectors)
        short = np.maximum(APART_M + 1e-3 - gap_m, 0.0)
        np.fill_diagonal(short, 0.0)  # to oneself
        if not short.any():
            break
        place = place + 0.5 * (short * (between_vectors / np.maximum(gap_m, 1e-6))).sum(
            axis=1
        )
    return place


def keep_out_of_vehicles(place: Floats, moved: Floats, vehicles: "Outlines") -> Floats:
    """Return places [2, M] outside of vehicles.

    They are ``moved``, but people who would come too near to a vehicle stay at
    ``place``.
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

        Distances are measured along the axes of the boxes, and negative inside.
        """
        dx, dy = points[:, :, None] - self._center[:, None]
        along = np.abs(self._cos * dx + self._sin * dy) - self._half_length
        across = np.abs(self._cos * dy - self._sin * dx) - self._half_width
        return np.asarray(np.maximum(along, across))
