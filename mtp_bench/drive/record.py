"""Record of a drive: collision, near misses, hard braking without a cause, comfort, and way driven."""

from collections.abc import Sequence

import numpy as np

from ..sources.highway.driven import STANDING, DrivenTraffic, Way
from ..sources.highway.simulate import boxes_meet
from ..sources.highway.world import CLASSES, RATE, World
from ..types import HARD_BRAKING, Bools, Drive, Floats
from .planner import Decision

COLLISION_TIME = 0.95  # s: a shorter time to collision is a near miss (nuPlan)
FREE = 30.0  # m ahead on the way without anybody: hard braking there has no cause
LIMITS = {"braking": -4.05, "gaining": 2.40, "across": 4.89, "jerk": 4.13}  # m/s2, m/s3: nuPlan's bounds of comfort
_BESIDE = 1.0  # m from the ego's strip
_LOOKS = (0.3, 0.6, COLLISION_TIME)  # s ahead, at constant velocities
_WINDOW = 15  # steps over which accelerations are smoothed before jerks are taken


def record_of(traffic: DrivenTraffic, stations: Floats, acceleration: Floats, plans: Sequence[Decision]) -> Drive:
    """The record of a drive until now.

    ``stations`` [N + 1] m of the ego at each step, ``acceleration`` [N] m/s2 between them; ``plans`` [F]: decisions.
    """
    world, hit = traffic.world(), traffic.collision
    speed = np.diff(stations) * RATE
    alone = ~occupied(world, traffic.way, stations, traffic.size)[:-1]
    return Drive(
        way=float(stations[-1] - stations[0]),
        seconds=float(world.time[-1]),
        goal=traffic.at_goal,
        collision="" if hit is None else CLASSES[hit.class_id],
        at_fault=hit is not None and hit.at_fault,
        near_misses=_runs(near_misses(world, speed, traffic.size)),
        phantom_brakes=_runs((acceleration < HARD_BRAKING) & alone),
        comfortable=is_comfortable(acceleration, speed, np.interp(stations[:-1], traffic.way.s, traffic.way.heading)),
        acceleration=acceleration,
        risk=np.array([plan.risk for plan in plans]),
        cause=np.array([plan.cause for plan in plans]),
        plan=traffic.way.at(np.array([plan.s for plan in plans]))[0],
        hit=-1 if hit is None else hit.number,
    )


def near_misses(world: World, speed: Floats, size: tuple[float, float]) -> Bools:
    """Mask [N] of the steps whose time to collision is below `COLLISION_TIME`, with a road user ahead or beside."""
    truth, steps = world.truth, len(speed)
    frame = truth.frame_of_rows
    rows = np.flatnonzero((frame < steps) & (np.hypot(*(truth.box[:, :2] - world.ego[frame, :2]).T) < FREE + 10))
    frame = frame[rows]
    yaw, moves, (x, y) = world.ego[frame, 3], speed[frame] > STANDING, (truth.box[rows, :2] - world.ego[frame, :2]).T
    ahead = x * np.cos(yaw) + y * np.sin(yaw) > 0
    near = np.zeros(len(rows), dtype=bool)
    for seconds in _LOOKS:
        own = np.zeros((len(rows), 7))
        own[:, :2] = world.ego[frame, :2] + (speed[frame] * seconds)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], 1)
        own[:, 3], own[:, 4:6] = yaw, size
        other = truth.box[rows].copy()
        other[:, :2] += truth.velocity[rows] * seconds
        near |= boxes_meet(own, other)
    return np.bincount(frame[near & ahead & moves], minlength=steps) > 0


def occupied(world: World, way: Way, stations: Floats, size: tuple[float, float]) -> Bools:
    """Mask [N + 1] of the steps with a road user on the way, or right beside it, within `FREE` m of the bumper."""
    truth = world.truth
    frame = truth.frame_of_rows
    rows = np.flatnonzero(np.hypot(*(truth.box[:, :2] - world.ego[frame, :2]).T) < FREE + 10)
    frame, box = frame[rows], truth.box[rows]
    found, reach = np.zeros(len(stations), dtype=bool), size[1] / 2 + box[:, 4:6].min(axis=1) / 2 + _BESIDE
    for ahead in np.arange(size[0] / 2, size[0] / 2 + FREE, 1.0):
        place = way.at(stations + ahead)[0][frame]
        found[frame[np.hypot(*(box[:, :2] - place).T) < reach]] = True
    return found


def is_comfortable(acceleration: Floats, speed: Floats, heading: Floats) -> bool:
    """True if a drive keeps within `LIMITS`: accelerations along and across, and the jerk of the smoothed one."""
    across = speed * np.gradient(heading) * RATE if len(heading) > 1 else np.zeros(1)
    within = (acceleration >= LIMITS["braking"]).all() and (acceleration <= LIMITS["gaining"]).all()
    if len(acceleration) >= _WINDOW:
        within &= bool((np.abs(smoothed_jerk(acceleration)) <= LIMITS["jerk"]).all())
    return bool(within and (np.abs(across) <= LIMITS["across"]).all())


def smoothed_jerk(acceleration: Floats) -> Floats:
    """Jerk [N] m/s3 of parabolas through `_WINDOW` accelerations [N] each (Savitzky-Golay, as in `scipy.signal`)."""
    k, half = np.arange(_WINDOW) - _WINDOW // 2, _WINDOW // 2
    _, slope, bend = np.linalg.pinv(np.stack([k**0, k, k**2], axis=1))
    slopes = RATE * (slope + 2 * np.outer(k, bend))  # [_WINDOW at which, _WINDOW through which]
    windows = np.lib.stride_tricks.sliding_window_view(acceleration, _WINDOW)
    return np.concatenate([slopes[:half] @ windows[0], windows @ slopes[half], slopes[half + 1 :] @ windows[-1]])


def _runs(mask: Bools) -> int:
    """Number of runs of True."""
    return int((np.diff(mask.astype(np.int8), prepend=0) == 1).sum())
