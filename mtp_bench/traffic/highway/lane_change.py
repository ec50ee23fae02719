"""Lane changes on roads along x: needed ones, profitable ones, making room.

Kesting, Treiber, Helbing (2007), "General lane-changing model MOBIL for car-following
models".
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats
from .driving import POLITENESS, RoadState, braking, free_acceleration
from .lanes import NO_LANE, RoadMap, RouteTable

_DECISION_PERIOD_S = 0.8
# from a vehicle's place in the lane: the last change is finished
_SETTLED_M = 0.5
_MIN_SPEED_MPS = 2.0  # slower vehicles do not change
_MIN_GAIN_MPS2 = 0.25
_RIGHT_BONUS_MPS2 = 0.1  # additional gain of a change to the right
# braking that a change may cause
_MAX_BRAKING_MPS2 = 2.0
_MAX_NEEDED_BRAKING_MPS2 = 3.5  # of a necessary change
_MIN_GAP_M = 2.0  # to both neighbours, and more at speed
_MIN_GAP_S = 0.25
# before the last chance, times the needed changes: a change is necessary
_NEEDED_ROOM_M = 260.0
# from the start of a route without changes, where other vehicles enter
_ENTRY_M = 60.0
_MIN_LANE_ROOM_M = 500.0  # lanes that end sooner are not entered without need
# before the exit: a vehicle outside the exit lane drives on
_MISSED_EXIT_M = 60.0
_SAME_LANE_M = 0.4
# braking for vehicles that have to merge: at least, and per politeness
_YIELDING_MPS2 = 0.6
_POLITE_YIELDING_MPS2 = 1.8
_BESIDE_M = 5.0  # between the middles of lanes beside each other


class _Neighbour(NamedTuple):
    """Nearest vehicle on one side."""

    row: int = NO_LANE  # `NO_LANE` without one
    gap: float = math.inf  # m

    @property
    def present(self) -> bool:
        """True if there is a vehicle."""
        return self.row != NO_LANE


class LaneChanges:
    """Lane changes of all drivers on a map with roads along x."""

    def __init__(self, road_map: RoadMap, routes: RouteTable) -> None:
        self._map = road_map
        self._routes = routes
        starts = [lane.position(0.0, 0.0) for lane in road_map.geometry.lanes]
        self._middle = np.array(starts, dtype=np.float64)[:, 1]

    def decide(
        self, state: RoadState, desired: Floats, step: int, step_s: float
    ) -> None:
        """Give a new lane number to vehicles that change lanes now.

        ``desired`` [N]: speeds, m/s.
        """
        middle_y = state.xy[1] - state.d  # of the present or target lane
        period = round(_DECISION_PERIOD_S / step_s)
        for i, vehicle in enumerate(state.vehicles):
            if (step + 3 * vehicle.number) % period:
                continue  # drivers decide in different steps
            route = vehicle.route
            lane = int(state.lane[i])
            otherwise = self._map.routes[route].otherwise
            missed = self._routes.room[route, lane] - state.s[i] < _MISSED_EXIT_M
            needed = self._routes.changes[route, lane] > 0
            if otherwise != NO_LANE and needed and missed:
                vehicle.route = otherwise
            settled = abs(state.d[i] - state.offset[i]) <= _SETTLED_M
            moves = state.speed[i] >= _MIN_SPEED_MPS
            if settled and moves and state.progress[i] >= _ENTRY_M:
                target = self._better_lane(state, i, desired, middle_y)
                if target != NO_LANE:
                    vehicle.lane_number = target
                    middle_y[i] = self._middle[target]

    def _better_lane(
        self, state: RoadState, i: int, desired: Floats, middle_y: Floats
    ) -> int:
        """Return the lane that vehicle i changes to, `NO_LANE` if it stays.

        ``desired`` [N]: speeds, m/s; ``middle_y`` [N]: y of the lanes that vehicles
        drive in or towards.
        """
        best_lane = NO_LANE
        best_gain = _MIN_GAIN_MPS2
        for target, bonus_mps2, is_needed in self._targets(state, i):
            gain = self._gain(
                state, i, desired, middle_y, self._middle[target], is_needed
            )
            if gain is None:
                continue
            if is_needed:  # counts more than any gain
                best_lane = target
                best_gain = math.inf
            elif gain + bonus_mps2 > best_gain:
                best_lane = target
                best_gain = gain + bonus_mps2
        return best_lane

    def _targets(self, state: RoadState, i: int) -> Iterator[tuple[int, float, bool]]:
        """Yield lanes that vehicle i may change to.

        With each lane come the bonus of the change, m/s2, and whether it is necessary.
        """
        routes = self._routes
        route = state.vehicles[i].route
        lane = int(state.lane[i])
        needed = routes.changes[route, lane]
        room_m = routes.room[route, lane] - state.s[i]
        for lane_side, bonus_mps2 in (
            (routes.left_lane, 0.0),
            (routes.right_lane, _RIGHT_BONUS_MPS2),
        ):
            target = int(lane_side[route, lane])
            if target == NO_LANE:
                continue
            if routes.changes[route, target] < needed:
                yield target, bonus_mps2, bool(room_m < _NEEDED_ROOM_M * needed)
                continue
            exit_is_near = needed and room_m < 2 * _NEEDED_ROOM_M * needed
            target_room_m = routes.room[route, target] - state.s[i]
            if not exit_is_near and target_room_m >= _MIN_LANE_ROOM_M:
                yield target, bonus_mps2, False

    def _gain(
        self,
        state: RoadState,
        i: int,
        desired: Floats,
        middle_y: Floats,
        target_middle: float,
        is_needed: bool,
    ) -> float | None:
        """Return the gain of acceleration by a change to a lane, m/s2.

        None if it is not safe; a change that ``is_needed`` may cause harder braking.
        ``desired`` and ``middle_y`` as in `_better_lane`; ``target_middle``: y of the
        lane.
        """
        touching_m = (state.width + state.width[i]) / 2 + _SAME_LANE_M
        in_target = np.abs(state.xy[1] - target_middle) < touching_m
        in_target |= np.abs(middle_y - target_middle) < _SAME_LANE_M
        in_present = np.abs(middle_y - middle_y[i]) < _SAME_LANE_M
        in_target[i] = False
        in_present[i] = False
        front, rear = _neighbours(state, i, in_target)
        min_gap_m = _MIN_GAP_M + _MIN_GAP_S * state.speed[i]
        if front.gap < min_gap_m or rear.gap < min_gap_m:
            return None
        braking_limit = -_MAX_NEEDED_BRAKING_MPS2 if is_needed else -_MAX_BRAKING_MPS2
        new_acceleration = _acceleration_behind(state, i, desired, front)
        others_gain = 0.0
        if rear.present:  # the follower in the target lane
            forced_acceleration = _acceleration_behind(
                state, rear.row, desired, rear._replace(row=i)
            )
            if forced_acceleration < braking_limit:
                return None
            gap_m = front.gap + rear.gap + state.length[i]
            ahead = front._replace(gap=gap_m)
            others_gain += forced_acceleration - _acceleration_behind(
                state, rear.row, desired, ahead
            )
        if new_acceleration < braking_limit:
            return None
        old_front, old_rear = _neighbours(state, i, in_present)
        if old_rear.present:  # the follower that is left behind
            gap_m = old_front.gap + old_rear.gap + state.length[i]
            ahead = old_front._replace(gap=gap_m)
            freed_acceleration = _acceleration_behind(
                state, old_rear.row, desired, ahead
            )
            behind_me = old_rear._replace(row=i)
            others_gain += freed_acceleration - _acceleration_behind(
                state, old_rear.row, desired, behind_me
            )
        old_acceleration = _acceleration_behind(state, i, desired, old_front)
        return float(
            new_acceleration
            - old_acceleration
            + state.style[i, POLITENESS] * others_gain
        )

    def bounds(self, state: RoadState, desired: Floats) -> Floats:
        """Return upper bounds [N] of the acceleration, m/s2.

        The bounds keep room for vehicles ahead and for vehicles that have to merge.
        """
        x = state.xy[0]
        middle_y = state.xy[1] - state.d
        # [N, N]: the row's vehicle behind that of the column
        gap_m = x - x[:, None] - (state.length + state.length[:, None]) / 2
        free = free_acceleration(state.speed, desired, state.style)[:, None]
        follow = free - braking(
            state.speed[:, None], gap_m, state.speed, state.style[:, None, :]
        )
        lateral_m = np.abs(middle_y - middle_y[:, None])
        ahead = (x > x[:, None]) & (gap_m > 0.0)
        same_lane = ahead & (lateral_m < _SAME_LANE_M)
        merging = self._routes.changes[state.route, state.lane] > 0
        room_m = self._routes.room[state.route, state.lane] - state.s
        merging &= room_m < _NEEDED_ROOM_M
        lets_in = ahead & (merging | merging[:, None]) & (lateral_m < _BESIDE_M)
        lets_in &= ~same_lane
        politeness = state.style[:, POLITENESS, None]
        braking_limit = -(_YIELDING_MPS2 + _POLITE_YIELDING_MPS2 * politeness)
        behind = np.where(same_lane, follow, np.inf).min(axis=1)
        yielding = np.where(lets_in, np.maximum(follow, braking_limit), np.inf).min(
            axis=1
        )
        return np.asarray(np.minimum(behind, yielding))


def _neighbours(
    state: RoadState, i: int, candidate_mask: Bools
) -> tuple[_Neighbour, _Neighbour]:
    """Return the nearest candidates ahead of and behind vehicle i."""
    along = state.xy[0] - state.xy[0, i]
    gap_m = np.abs(along) - (state.length + state.length[i]) / 2
    return _nearest(gap_m, candidate_mask & (along >= 0)), _nearest(
        gap_m, candidate_mask & (along < 0)
    )


def _nearest(gap_m: Floats, mask: Bools) -> _Neighbour:
    distance_m = np.where(mask, gap_m, np.inf)
    row = int(np.argmin(distance_m))
    if np.isinf(distance_m[row]):
        return _Neighbour()
    return _Neighbour(row, float(distance_m[row]))


def _acceleration_behind(
    state: RoadState, i: int, desired: Floats, leader: _Neighbour
) -> float:
    """Return the acceleration of vehicle i behind a leader, m/s2."""
    style = state.style[i]
    speed = state.speed[i]
    free = float(free_acceleration(speed, desired[i], style))
    if not leader.present:
        return free
    gap_m = np.asarray(leader.gap)
    return free - float(braking(speed, gap_m, state.speed[leader.row], style))
