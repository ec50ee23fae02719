"""Lane changes on roads along x: necessary ones, profitable ones (MOBIL), and making room for others.

Kesting, Treiber, Helbing (2007), "General lane-changing model MOBIL for car-following models".
"""

import numpy as np

from ...core import Bools, Floats
from .driving import RoadState, braking, free_acceleration
from .lanes import NO_LANE, RouteTable
from .networks import RoadMap

_PERIOD = 0.8  # s between two decisions of a driver
_SETTLED = 0.5  # m from its place in the lane: the last change is finished
_SLOWEST = 2.0  # m/s; slower vehicles do not change
_GAIN, _RIGHT_BONUS = (
    0.25,
    0.1,
)  # m/s2: least gain of a change; additional gain of a change to the right
_SAFE, _NEEDED = 2.0, 3.5  # m/s2 of braking that a change may cause; a necessary change
_LEAST, _LEAST_TIME = 2.0, 0.25  # m and s to both neighbours
_AHEAD = (
    260.0  # m before the last chance, times the needed changes: a change is necessary
)
_ENTRY = 60.0  # m from the start of a route without changes, where other vehicles enter
_KEEP_OFF = 500.0  # m: lanes that end sooner are not entered without need
_TOO_LATE = 60.0  # m before the exit: a vehicle outside the exit lane drives on
_BESIDE = 0.4  # m
_KINDNESS = (
    0.6,
    1.8,
)  # m/s2 of braking for vehicles that have to merge: at least, and per politeness
_NEAR = 5.0  # m between the middles of lanes beside each other


class LaneChanges:
    """Lane changes of all drivers on a map with roads along x."""

    def __init__(self, road_map: RoadMap, routes: RouteTable) -> None:
        self._map, self._routes = road_map, routes
        self._middle = np.array(
            [float(lane.position(0.0, 0.0)[1]) for lane in road_map.geometry.lanes]
        )

    def decide(self, state: RoadState, desired: Floats, step: int, dt: float) -> None:
        """Give a new lane number to vehicles that change lanes now; ``desired``: speeds ``[N]``."""
        y = state.xy[1] - state.d  # the middle of the present or target lane
        period = round(_PERIOD / dt)
        for i, vehicle in enumerate(state.vehicles):
            if (step + 3 * vehicle.number) % period:
                continue
            route, lane = int(state.route[i]), int(state.lane[i])
            otherwise = self._map.routes[route].otherwise
            missed = self._routes.room[route, lane] - state.s[i] < _TOO_LATE
            if (
                otherwise != NO_LANE
                and self._routes.changes[route, lane] > 0
                and missed
            ):
                vehicle.route = otherwise
            changing = abs(state.d[i] - state.offset[i]) > _SETTLED
            if changing or state.speed[i] < _SLOWEST or state.progress[i] < _ENTRY:
                continue
            lane = self._better_lane(state, i, desired, y)
            if lane != NO_LANE:
                vehicle.lane_number = lane
                y[i] = self._middle[lane]

    def _better_lane(self, state: RoadState, i: int, desired: Floats, y: Floats) -> int:
        routes, route, lane = (
            self._routes,
            int(state.vehicles[i].route),
            int(state.lane[i]),
        )
        needed = routes.changes[route, lane]
        left = routes.room[route, lane] - state.s[i]
        best, most = NO_LANE, _GAIN
        for side, bonus in ((routes.left, 0.0), (routes.right, _RIGHT_BONUS)):
            target = int(side[route, lane])
            if target == NO_LANE:
                continue
            fewer = routes.changes[route, target] < needed
            must = fewer and left < _AHEAD * needed
            if needed and not fewer and left < 2 * _AHEAD * needed:
                continue
            if not fewer and routes.room[route, target] - state.s[i] < _KEEP_OFF:
                continue
            gain = self._gain(state, i, desired, y, self._middle[target], bool(must))
            if gain is not None and (must or gain + bonus > most):
                best, most = target, np.inf if must else gain + bonus
        return best

    def _gain(
        self,
        state: RoadState,
        i: int,
        desired: Floats,
        y: Floats,
        middle: float,
        must: bool,
    ) -> float | None:
        """Gain of a change to the lane at ``middle``, m/s2; None if it is not safe."""
        wide = (state.width + state.width[i]) / 2 + _BESIDE
        in_target = (np.abs(state.xy[1] - middle) < wide) | (
            np.abs(y - middle) < _BESIDE
        )
        in_present = np.abs(y - y[i]) < _BESIDE
        in_target[i] = in_present[i] = False
        front, rear = _neighbours(state, i, in_target)
        limit = -_NEEDED if must else -_SAFE
        for j, gap in (front, rear):
            if j != NO_LANE and gap < _LEAST + _LEAST_TIME * state.speed[i]:
                return None
        own = _acceleration_behind(state, i, desired, *front)
        others = 0.0
        if rear[0] != NO_LANE:
            forced = _acceleration_behind(state, rear[0], desired, i, rear[1])
            if forced < limit:
                return None
            gap = front[1] + rear[1] + state.length[i]
            others += forced - _acceleration_behind(
                state, rear[0], desired, front[0], gap
            )
        if own < limit:
            return None
        old_front, old_rear = _neighbours(state, i, in_present)
        if old_rear[0] != NO_LANE:
            gap = old_front[1] + old_rear[1] + state.length[i]
            freed = _acceleration_behind(state, old_rear[0], desired, old_front[0], gap)
            others += freed - _acceleration_behind(
                state, old_rear[0], desired, i, old_rear[1]
            )
        politeness = state.style[i, 6]
        return float(
            own
            - _acceleration_behind(state, i, desired, *old_front)
            + politeness * others
        )

    def bounds(self, state: RoadState, desired: Floats) -> Floats:
        """Upper bounds ``[N]`` of the acceleration, for vehicles ahead and those that have to merge."""
        y = state.xy[1] - state.d
        x = state.xy[0]
        gap = x - x[:, None] - (state.length + state.length[:, None]) / 2
        free = free_acceleration(state.speed, desired, state.style)[:, None]
        follow = free - braking(
            state.speed[:, None], gap, state.speed, state.style[:, None, :]
        )
        aside = np.abs(y - y[:, None])
        ahead = (x > x[:, None]) & (gap > 0.0)
        same = ahead & (aside < _BESIDE)
        needy = self._routes.changes[state.route, state.lane] > 0
        merging = needy & (
            self._routes.room[state.route, state.lane] - state.s < _AHEAD
        )
        kind = ahead & (merging | merging[:, None]) & (aside < _NEAR) & ~same
        limit = -(_KINDNESS[0] + _KINDNESS[1] * state.style[:, 6, None])
        behind: Floats = np.where(same, follow, np.inf).min(axis=1)
        giving: Floats = np.where(kind, np.maximum(follow, limit), np.inf).min(axis=1)
        return np.minimum(behind, giving)


def _neighbours(
    state: RoadState, i: int, among: Bools
) -> tuple[tuple[int, float], tuple[int, float]]:
    """Nearest vehicles ahead and behind with their gaps; NO_LANE and inf without one."""
    along = state.xy[0] - state.xy[0, i]
    gap = np.abs(along) - (state.length + state.length[i]) / 2
    nearest = []
    for side in (along >= 0, along < 0):
        distance = np.where(among & side, gap, np.inf)
        j = int(np.argmin(distance))
        nearest.append(
            (j, float(distance[j])) if np.isfinite(distance[j]) else (NO_LANE, np.inf)
        )
    return nearest[0], nearest[1]


def _acceleration_behind(
    state: RoadState, i: int, desired: Floats, j: int, gap: float
) -> float:
    style = state.style[i]
    free = float(free_acceleration(state.speed[i], desired[i], style))
    if j == NO_LANE:
        return free
    return free - float(braking(state.speed[i], np.asarray(gap), state.speed[j], style))
