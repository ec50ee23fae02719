"""Record of a drive: collision, near misses, hard braking without a cause, comfort, and way driven."""

from collections.abc import Sequence

import numpy as np

from ...core import HARD_BRAKING, Bools, Drive, Floats, Ints, Truth, unit_vectors
from ..highway.driven import STANDING, DrivenTraffic, Way
from ..highway.simulate import boxes_meet
from ..highway.world import CLASSES, RATE, World
from .planner import Decision

COLLISION_TIME = 0.95  # s: a shorter time to collision is a near miss (nuPlan)
FREE = 30.0  # m ahead on the way without anybody: hard braking there has no cause
LIMITS = {
    "braking": -4.05,
    "gaining": 2.40,
    "across": 4.89,
    "jerk": 4.13,
}  # m/s2, m/s3: nuPlan's bounds of comfort
_BESIDE = 1.0  # m from the ego's strip
_LOOKS = (0.3, 0.6, COLLISION_TIME)  # s ahead, at constant velocities
_WINDOW = 15  # steps over which accelerations are smoothed before jerks are taken


def record_of(
    traffic: DrivenTraffic,
    stations: Floats,
    acceleration: Floats,
    plans: Sequence[Decision],
) -> Drive:
    """Return the record of a drive until now, with the definitions of docs/definitions/driving.md.

    ``stations`` [N + 1] m of the ego at each step, ``acceleration`` [N] m/s2 between them; ``plans`` [F]: decisions.
    """
    world = traffic.world()
    way = traffic.way
    hit = traffic.collision
    speed = np.diff(stations) * RATE
    alone = ~occupied(world, way, stations[:-1], traffic.size)
    return Drive(
        way=float(stations[-1] - stations[0]),
        seconds=float(world.time[-1]),
        goal=traffic.at_goal,
        collision="" if hit is None else CLASSES[hit.class_id],
        at_fault=hit is not None and hit.at_fault,
        near_misses=_runs(near_misses(world, speed, traffic.size)),
        phantom_brakes=_runs((acceleration < HARD_BRAKING) & alone),
        comfortable=is_comfortable(
            acceleration, speed, np.interp(stations[:-1], way.s, way.heading)
        ),
        acceleration=acceleration,
        risk=np.array([plan.risk for plan in plans]),
        cause=np.array([plan.cause for plan in plans]),
        plan=way.at(np.array([plan.s for plan in plans]))[0],
        hit=-1 if hit is None else hit.number,
        size=np.array(traffic.size),
        station=stations,
        route=np.column_stack([way.s, way.xy, way.heading]),
    )


def rows_from(truth: Truth, first: int) -> Floats:
    """Return the rows [R, 12] from the state ``first`` on: state, number, class, box, velocity."""
    columns = [
        truth.frame_of_rows,
        truth.object_id,
        truth.class_id,
        truth.box,
        truth.velocity,
    ]
    return np.column_stack(columns).astype(float)[truth.frame_of_rows >= first]


def near_misses(world: World, speed: Floats, size: tuple[float, float]) -> Bools:
    """Mask [N] of the steps whose time to collision is below `COLLISION_TIME`, with a road user ahead or beside."""
    rows, frame = _rows_around(world, len(speed))
    box = world.truth.box[rows]
    place = world.ego[frame, :2]
    yaw = world.ego[frame, 3]
    heading = unit_vectors(yaw)
    velocity = speed[frame, None] * heading
    ahead = ((box[:, :2] - place) * heading).sum(axis=1) > 0
    other = box.copy()
    ego = np.zeros_like(box)
    ego[:, 3] = yaw
    ego[:, 4:6] = size
    near = np.zeros(len(rows), dtype=bool)
    for seconds in _LOOKS:
        ego[:, :2] = place + seconds * velocity
        other[:, :2] = box[:, :2] + seconds * world.truth.velocity[rows]
        near |= boxes_meet(ego, other)
    return (
        np.bincount(
            frame[near & ahead & (speed[frame] > STANDING)], minlength=len(speed)
        )
        > 0
    )


def occupied(
    world: World, way: Way, stations: Floats, size: tuple[float, float]
) -> Bools:
    """Mask [N] of the states with a road user on the way, or right beside it, within `FREE` m of the bumper."""
    rows, frame = _rows_around(world, len(stations))
    box = world.truth.box[rows]
    found = np.zeros(len(stations), dtype=bool)
    reach = size[1] / 2 + box[:, 4:6].min(axis=1) / 2 + _BESIDE
    for ahead in np.arange(size[0] / 2, size[0] / 2 + FREE, 1.0):
        place = way.at(stations + ahead)[0][frame]
        found[frame[np.hypot(*(box[:, :2] - place).T) < reach]] = True
    return found


def _rows_around(world: World, states: int) -> tuple[Ints, Ints]:
    """Return rows and states [R] of the road users near the ego, in the first ``states``."""
    frame = world.truth.frame_of_rows
    away = world.truth.box[:, :2] - world.ego[frame, :2]
    rows = np.flatnonzero((np.hypot(*away.T) < FREE + 10) & (frame < states))
    return rows, frame[rows]


def is_comfortable(acceleration: Floats, speed: Floats, heading: Floats) -> bool:
    """True if a drive keeps within `LIMITS`: accelerations along and across, and the jerk of the smoothed one."""
    across = speed * np.gradient(heading) * RATE if len(heading) > 1 else np.zeros(1)
    within = (acceleration >= LIMITS["braking"]).all() and (
        acceleration <= LIMITS["gaining"]
    ).all()
    if len(acceleration) >= _WINDOW:
        within &= bool((np.abs(smoothed_jerk(acceleration)) <= LIMITS["jerk"]).all())
    return bool(within and (np.abs(across) <= LIMITS["across"]).all())


def smoothed_jerk(acceleration: Floats) -> Floats:
    """Return the jerk [N] m/s3: slopes of parabolas through `_WINDOW` accelerations [N] each.

    The filter of Savitzky and Golay, as `scipy.signal.savgol_filter` has it, whose import takes over a second.
    """
    half = _WINDOW // 2
    k = np.arange(_WINDOW) - half
    windows = np.lib.stride_tricks.sliding_window_view(acceleration, _WINDOW)
    _, slope, bend = np.polynomial.polynomial.polyfit(k, windows.T, 2)
    first = slope[0] + 2 * bend[0] * k[:half]
    last = slope[-1] + 2 * bend[-1] * k[half + 1 :]
    return RATE * np.concatenate([first, slope, last])


def _runs(mask: Bools) -> int:
    """Number of runs of True."""
    return int((np.diff(mask.astype(np.int8), prepend=0) == 1).sum())
