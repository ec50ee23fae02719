"""Record of a drive: collision, near misses, hard braking, comfort, and way driven."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ..core import (
    HARD_BRAKING,
    Bools,
    Drive,
    Floats,
    Ints,
    RolloutError,
    Truth,
    boxes_meet,
    true_runs,
    unit_vectors,
)
from .highway.driven import STANDING, DrivenTraffic, Way
from .highway.source import unpack
from .highway.world import CLASSES, RATE, World
from .planner import Decision

COLLISION_TIME = 0.95  # s: a shorter time to collision is a near miss (nuPlan)
# m ahead on the way: hard braking without a road user there has no cause
FREE = 30.0
# nuPlan's bounds of comfort
_MIN_ACCELERATION_MPS2 = -4.05
_MAX_ACCELERATION_MPS2 = 2.40
_MAX_LATERAL_MPS2 = 4.89
_MAX_JERK_MPS3 = 4.13
_STRIP_MARGIN_M = 1.0  # beside the ego's strip
_NEAR_M = FREE + 10.0  # of the ego: other road users are left out at once
_LOOK_AHEAD_S = (0.3, 0.6, COLLISION_TIME)  # at constant velocities
_JERK_WINDOW = 15  # steps over which accelerations are smoothed before jerks are taken


def record_of(
    traffic: DrivenTraffic,
    stations: Floats,
    acceleration_mps2: Floats,
    plans: Sequence[Decision],
) -> Drive:
    """Return the record of a drive until now.

    docs/definitions/driving.md has the definitions. ``stations`` [N + 1] m of the ego
    at each step, ``acceleration_mps2`` [N] m/s2 between them; ``plans`` [F]: decisions.
    """
    world = traffic.world()
    way = traffic.way
    hit = traffic.collision
    speed_mps = np.diff(stations) * RATE
    heading = np.interp(stations[:-1], way.s, way.heading)
    hard_braking = acceleration_mps2 < HARD_BRAKING
    without_cause = ~occupied(world, way, stations[:-1], traffic.size)
    return Drive(
        way=float(stations[-1] - stations[0]),
        seconds=float(world.time[-1]),
        goal=traffic.at_goal,
        collision="" if hit is None else CLASSES[hit.class_id],
        at_fault=hit is not None and hit.at_fault,
        near_misses=len(true_runs(near_misses(world, speed_mps, traffic.size))),
        phantom_brakes=len(true_runs(hard_braking & without_cause)),
        comfortable=is_comfortable(acceleration_mps2, speed_mps, heading),
        acceleration=acceleration_mps2,
        risk=np.array([plan.risk for plan in plans]),
        cause=np.array([plan.cause for plan in plans]),
        plan=way.at(np.array([plan.s for plan in plans]))[0],
        hit=-1 if hit is None else hit.number,
        size=np.array(traffic.size),
        station=stations,
        route=np.column_stack([way.s, way.xy, way.heading]),
    )


def rows_from(truth: Truth, first: int) -> Floats:
    """Return the rows [R, 12] of a truth from state ``first`` on.

    There is a state for each step of the simulation. Columns: state, number, class, box
    (7), velocity (2).
    """
    state = truth.frame_of_rows
    columns = [state, truth.object_id, truth.class_id, truth.box, truth.velocity]
    return np.column_stack(columns).astype(float)[state >= first]


@lru_cache(1)  # a video draws every state of one drive
def drive_rows(drive: Drive) -> Floats:
    """Return the rows [R, 12] of all states of a stored drive, as `rows_from`.

    Raises RolloutError.
    """
    try:
        truth = unpack(drive.world).truth
        return np.concatenate([rows_from(truth, 0), drive.world["ending"]])
    except (LookupError, TypeError, ValueError) as error:  # an edited file
        raise RolloutError(
            f"the recording of a drive cannot be read ({error}): run the agent again"
        ) from None


def near_misses(world: World, speed_mps: Floats, size: tuple[float, float]) -> Bools:
    """Return the mask [N] of the steps with a near miss.

    In such a step the time to collision with a road user ahead or beside is below
    `COLLISION_TIME`. ``speed_mps`` [N]: of the ego; ``size``: its length and width, m.
    """
    rows, state = _rows_around(world, len(speed_mps))
    box = world.truth.box[rows]
    ego_xy = world.ego[state, :2]
    ego_yaw = world.ego[state, 3]
    direction = unit_vectors(ego_yaw)
    is_ahead = ((box[:, :2] - ego_xy) * direction).sum(axis=1) > 0
    later_box = box.copy()
    later_ego = np.zeros_like(box)
    later_ego[:, 3] = ego_yaw
    later_ego[:, 4:6] = size
    meets = np.zeros(len(rows), dtype=bool)
    for seconds in _LOOK_AHEAD_S:
        later_ego[:, :2] = ego_xy + seconds * (speed_mps[state, None] * direction)
        later_box[:, :2] = box[:, :2] + seconds * world.truth.velocity[rows]
        meets |= boxes_meet(later_ego, later_box)
    is_near_miss = meets & is_ahead & (speed_mps[state] > STANDING)
    return np.bincount(state[is_near_miss], minlength=len(speed_mps)) > 0


def occupied(
    world: World, way: Way, stations: Floats, size: tuple[float, float]
) -> Bools:
    """Mark the states [N] with a road user close ahead.

    It is on the way, or right beside it, within `FREE` m of the bumper.
    """
    rows, state = _rows_around(world, len(stations))
    box = world.truth.box[rows]
    mask = np.zeros(len(stations), dtype=bool)
    reach_m = size[1] / 2 + box[:, 4:6].min(axis=1) / 2 + _STRIP_MARGIN_M
    # points of the way, every metre from the bumper on
    for ahead_m in np.arange(size[0] / 2, size[0] / 2 + FREE, 1.0):
        way_xy = way.at(stations + ahead_m)[0][state]
        mask[state[np.hypot(*(box[:, :2] - way_xy).T) < reach_m]] = True
    return mask


def _rows_around(world: World, states: int) -> tuple[Ints, Ints]:
    """Return rows and states [R] of road users near the ego.

    States after the first ``states`` are left out.
    """
    state = world.truth.frame_of_rows
    offset = world.truth.box[:, :2] - world.ego[state, :2]
    rows = np.flatnonzero((np.hypot(*offset.T) < _NEAR_M) & (state < states))
    return rows, state[rows]


def is_comfortable(
    acceleration_mps2: Floats, speed_mps: Floats, heading: Floats
) -> bool:
    """Return True if a drive keeps within nuPlan's bounds.

    There are bounds for the accelerations along and across, and for the jerk of the
    smoothed acceleration.
    """
    comfortable = (acceleration_mps2 >= _MIN_ACCELERATION_MPS2).all()
    comfortable &= (acceleration_mps2 <= _MAX_ACCELERATION_MPS2).all()
    if len(heading) > 1:
        lateral = speed_mps * np.gradient(heading) * RATE
        comfortable &= (np.abs(lateral) <= _MAX_LATERAL_MPS2).all()
    if len(acceleration_mps2) >= _JERK_WINDOW:
        jerk = smoothed_jerk(acceleration_mps2)
        comfortable &= (np.abs(jerk) <= _MAX_JERK_MPS3).all()
    return bool(comfortable)


def smoothed_jerk(acceleration_mps2: Floats) -> Floats:
    """Return the jerk [N] m/s3: slopes of parabolas through 15 accelerations each.

    This is the filter of Savitzky and Golay, as `scipy.signal.savgol_filter`, whose
    import takes over a second.
    """
    half = _JERK_WINDOW // 2
    step = np.arange(_JERK_WINDOW) - half  # 0 in the middle of a window
    windows = np.lib.stride_tricks.sliding_window_view(acceleration_mps2, _JERK_WINDOW)
    # constant + linear * step + square * step^2 has the slope ``linear`` at step 0
    _, linear, square = np.polynomial.polynomial.polyfit(step, windows.T, 2)
    # the first and the last steps are in the middle of no window
    first = linear[0] + 2 * square[0] * step[:half]
    final = linear[-1] + 2 * square[-1] * step[half + 1 :]
    return RATE * np.concatenate([first, linear, final])
