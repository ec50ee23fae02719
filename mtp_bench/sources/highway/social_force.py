"""How people on foot move among each other and around vehicles.

Social forces: Helbing and Molnár (1995), "Social force model for pedestrian dynamics", with a pull towards the group as
in Moussaïd et al. (2010), "The walking behaviour of pedestrian social groups". Nobody comes closer to anybody than
`APART`, so that no two boxes overlap.
"""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints

APART = 0.8  # m between two middles, always
_RELAX = 0.5  # s
_PUSH, _RANGE, _SIGHT = 2.1, 0.35, 3.0  # m/s2, m, m
_BLIND = 0.35  # share of the push from somebody behind
_FRIEND = 0.3  # share of the push from somebody of the same group
_PULL, _TOGETHER = 0.5, 1.3  # 1/s2 towards the middle of a group that is farther away than this, m
_SLOWING = 0.8  # s, who is nearer to the goal slows down
_FROM_BOX = 0.42  # m to the outline of a vehicle that nobody steps into
_ROOM = 0.65  # m to it where people come to a stop
_TINY = 1e-9
_EASY = 2.5  # m/s2, how people slow down before each other and before vehicles
_STRONGEST = 3.0  # m/s2 of force


def social_force(place: Floats, velocity: Floats, to_goal: Floats, pace: Floats, group: Ints) -> Floats:
    """Acceleration ``[M, 2]``, m/s2, of people on foot.

    ``place`` ``[M, 2]`` m, ``velocity`` ``[M, 2]`` m/s, ``to_goal`` ``[M, 2]`` the way that is left, ``pace`` ``[M]``
    the speed that they like, ``group`` ``[M]`` a number that companions share.
    """
    far = np.hypot(to_goal[:, 0], to_goal[:, 1])
    wanted = to_goal / np.maximum(far, _TINY)[:, None] * np.minimum(pace, far / _SLOWING)[:, None]
    between, gap, unit = _pairs(place)
    ahead = wanted / np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), _TINY)[:, None]
    facing = -(ahead[:, None, :] * unit).sum(axis=2)
    friends: Bools = (group[:, None] == group) & np.isfinite(gap)
    strength = _PUSH * np.exp((APART - gap) / _RANGE) * (gap < _SIGHT) * np.where(friends, _FRIEND, 1.0)
    strength *= _BLIND + (1 - _BLIND) * (1 + facing) / 2
    push: Floats = (strength[..., None] * unit).sum(axis=1)
    force: Floats = (wanted - velocity) / _RELAX + push + _pull(between, friends)
    return shortened(force, _STRONGEST)


def _pairs(place: Floats, least: float = _TINY) -> tuple[Floats, Floats, Floats]:
    """Ways from everybody to everybody ``[M, M, 2]``, their lengths (inf to oneself), and the ways 1 m long."""
    between = place[:, None] - place
    gap = np.hypot(between[..., 0], between[..., 1])
    np.fill_diagonal(gap, np.inf)
    return between, gap, between / np.where(np.isinf(gap), 1.0, np.maximum(gap, least))[..., None]


def shortened(vector: Floats, most: Floats | float) -> Floats:
    """Vectors ``[M, 2]`` that are no longer than ``most``."""
    length = np.hypot(vector[:, 0], vector[:, 1])
    return vector * np.minimum(1.0, most / np.maximum(length, _TINY))[:, None]


def _pull(between: Floats, friends: Bools) -> Floats:
    count = friends.sum(axis=1)
    to_middle = -(between * friends[..., None]).sum(axis=1) / np.maximum(count, 1)[:, None]
    away = np.hypot(to_middle[:, 0], to_middle[:, 1]) > _TOGETHER
    return np.asarray(to_middle * np.where(away, _PULL, 0.0)[:, None])


def eased(place: Floats, velocity: Floats, vehicles: Floats, dt: float) -> Floats:
    """Velocities ``[M, 2]`` at which people can stop before they meet anybody or a vehicle (boxes ``[N, 7]``)."""
    _, gap, unit = _pairs(place)
    mine = -(velocity[:, None, :] * unit).sum(axis=2)  # how fast I come
    theirs = mine.T
    allowed = np.sqrt(2.0 * _EASY * np.maximum(np.where(np.isinf(gap), 0.0, gap) - APART, 0.0))
    excess = np.maximum(mine + theirs - allowed, 0.0)
    excess *= np.maximum(mine, 0.0) / np.maximum(np.maximum(mine, 0.0) + np.maximum(theirs, 0.0), _TINY)
    worst = np.argmax(excess, axis=1)
    rows = np.arange(len(place))
    velocity = velocity + excess[rows, worst, None] * unit[rows, worst]
    if len(vehicles) == 0:
        return velocity
    before = _clearance(place, vehicles)
    coming = (before - _clearance(place + dt * velocity, vehicles)) / dt
    allowed = np.sqrt(2.0 * _EASY * np.maximum(before - _ROOM, 0.0))
    share = np.where(coming > allowed, allowed / np.maximum(coming, _TINY), 1.0).min(axis=1)
    return np.asarray(velocity * share[:, None])


def kept_apart(place: Floats) -> Floats:
    """Places ``[M, 2]`` after pushing those apart who are too close."""
    for _ in range(3):
        _, gap, unit = _pairs(place, 1e-6)
        short = np.maximum(APART + 1e-3 - gap, 0.0)
        if not short.any():
            break
        place = place + 0.5 * (short[..., None] * unit).sum(axis=1)
    return place


def kept_out(place: Floats, moved: Floats, vehicles: Floats) -> Floats:
    """``moved`` ``[M, 2]``, but who would step against a vehicle (boxes ``[N, 7]``) stays at ``place``."""
    if len(vehicles) == 0:
        return moved
    after, before = _clearance(moved, vehicles), _clearance(place, vehicles)
    blocked = np.any((after < _FROM_BOX) & (after < before), axis=1)
    return np.where(blocked.reshape(-1, 1), place, moved)


def _clearance(points: Floats, boxes: Floats) -> Floats:
    """Distance ``[M, N]`` of points to the outlines of boxes along their axes; negative inside."""
    cos, sin = np.cos(boxes[:, 3]), np.sin(boxes[:, 3])
    dx, dy = points[:, :1] - boxes[:, 0], points[:, 1:] - boxes[:, 1]
    along = np.abs(cos * dx + sin * dy) - boxes[:, 4] / 2
    across = np.abs(cos * dy - sin * dx) - boxes[:, 5] / 2
    return np.maximum(along, across)
