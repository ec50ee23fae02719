"""Changing lanes on roads along x: necessary changes, changes that pay (MOBIL), and making room for others.

Kesting, Treiber, Helbing (2007), "General lane-changing model MOBIL for car-following models".
"""

from __future__ import annotations

import numpy as np

from ...types import Floats
from .following import braking, free_acceleration
from .lane_geometry import LaneGeometry
from .networks import RoadMap
from .routes import NOWHERE, RouteTable
from .state import State

_EVERY = 0.8  # s between two decisions of a driver
_SETTLED = 0.5  # m from its place in the lane: the last change is over
_SLOWEST = 2.0  # m/s, who is slower does not change
_GAIN, _TO_THE_RIGHT = 0.25, 0.1  # m/s2 that a change must bring; a change to the right brings this much by itself
_SAFE, _NEEDED = 2.0, 3.5  # m/s2 of braking that a change may ask of others; a necessary one
_LEAST, _LEAST_TIME = 2.0, 0.25  # m and s to both neighbours
_AHEAD = 260.0  # m before the last chance, times the changes needed: from here on a change is necessary
_ENTRY = 60.0  # m from the start of a route, where others come in: no changes
_KEEP_OFF = 500.0  # m: lanes that end sooner are not entered without need
_TOO_LATE = 60.0  # m: who is not in the exit lane by then drives on
_BESIDE = 0.4  # m
_KINDNESS = (0.6, 1.8)  # m/s2 of braking for those who have to come in: at least, and per politeness


class LaneChanges:
    """Decisions of all drivers on a map where lanes are changed; roads run along x."""

    def __init__(self, town: RoadMap, routes: RouteTable) -> None:
        self._map, self._routes = town, routes
        geometry: LaneGeometry = town.geometry
        self._middle = np.array([float(lane.position(0.0, 0.0)[1]) for lane in geometry.lanes])

    def decide(self, state: State, wanted: Floats, step: int, dt: float) -> None:
        """Gives those vehicles another lane number who change lanes now; ``wanted``: desired speeds ``[N]``."""
        y = state.xy[:, 1] - state.d  # the middle of the lane that everybody is in or bound for
        period = round(_EVERY / dt)
        for i, vehicle in enumerate(state.vehicles):
            if (step + 3 * vehicle.number) % period:
                continue
            self._drive_on(state, i)
            changing = abs(state.d[i] - state.aside[i]) > _SETTLED
            if changing or state.speed[i] < _SLOWEST or state.way[i] < _ENTRY:
                continue
            lane = self._better(state, i, wanted, y)
            if lane != NOWHERE:
                vehicle.lane_number = lane
                y[i] = self._middle[lane]

    def _drive_on(self, state: State, i: int) -> None:
        route, lane = int(state.route[i]), int(state.lane[i])
        instead = self._map.routes[route].otherwise
        missed = self._routes.room[route, lane] - state.s[i] < _TOO_LATE
        if instead != NOWHERE and self._routes.hops[route, lane] > 0 and missed:
            state.vehicles[i].route = instead

    def _better(self, state: State, i: int, wanted: Floats, y: Floats) -> int:
        routes, route, lane = self._routes, int(state.vehicles[i].route), int(state.lane[i])
        needed = routes.hops[route, lane]
        left = routes.room[route, lane] - state.s[i]
        best, most = NOWHERE, _GAIN
        for side, bonus in ((routes.left, 0.0), (routes.right, _TO_THE_RIGHT)):
            to = int(side[route, lane])
            if to == NOWHERE:
                continue
            fewer = routes.hops[route, to] < needed
            must = fewer and left < _AHEAD * needed
            if needed and not fewer and left < 2 * _AHEAD * needed:
                continue
            if not fewer and routes.room[route, to] - state.s[i] < _KEEP_OFF:
                continue
            gain = self._gain(state, i, wanted, y, self._middle[to], bool(must))
            if gain is not None and (must or gain + bonus > most):
                best, most = to, np.inf if must else gain + bonus
        return best

    def _gain(self, state: State, i: int, wanted: Floats, y: Floats, middle: float, must: bool) -> float | None:
        """What a change to the lane at ``middle`` brings, m/s2; None: it is not safe."""
        wide = (state.width + state.width[i]) / 2 + _BESIDE
        there = (np.abs(state.xy[:, 1] - middle) < wide) | (np.abs(y - middle) < _BESIDE)
        here = np.abs(y - y[i]) < _BESIDE
        there[i] = here[i] = False
        front, rear = _neighbours(state, i, there)
        bound = -_NEEDED if must else -_SAFE
        for j, gap in (front, rear):
            if j != NOWHERE and gap < _LEAST + _LEAST_TIME * state.speed[i]:
                return None
        mine = _follow(state, i, wanted, *front)
        others = 0.0
        if rear[0] != NOWHERE:
            forced = _follow(state, rear[0], wanted, i, rear[1])
            if forced < bound:
                return None
            others += forced - _follow(state, rear[0], wanted, front[0], front[1] + rear[1] + state.length[i])
        if mine < bound:
            return None
        old_front, old_rear = _neighbours(state, i, here)
        if old_rear[0] != NOWHERE:
            freed = _follow(state, old_rear[0], wanted, old_front[0], old_front[1] + old_rear[1] + state.length[i])
            others += freed - _follow(state, old_rear[0], wanted, i, old_rear[1])
        politeness = state.temper[i, 6]
        return float(mine - _follow(state, i, wanted, *old_front) + politeness * others)

    def bounds(self, state: State, wanted: Floats) -> Floats:
        """Upper bounds ``[N]`` of the acceleration: for those who come in ahead, for lanes that end."""
        y = state.xy[:, 1] - state.d
        x = state.xy[:, 0]
        gap = x - x[:, None] - (state.length + state.length[:, None]) / 2
        free = free_acceleration(state.speed, wanted, state.temper)[:, None]
        temper = state.temper[:, None, :]
        follow = free - braking(state.speed[:, None], gap, state.speed, temper)
        aside = np.abs(y - y[:, None])
        ahead = (x > x[:, None]) & (gap > 0.0)
        same = ahead & (aside < _BESIDE)
        needy = self._routes.hops[state.route, state.lane] > 0
        merging = needy & (self._routes.room[state.route, state.lane] - state.s < _AHEAD)
        kind = ahead & (merging | merging[:, None]) & (aside < 5.0) & ~same
        limit = -(_KINDNESS[0] + _KINDNESS[1] * state.temper[:, 6, None])
        behind: Floats = np.where(same, follow, np.inf).min(axis=1)
        giving: Floats = np.where(kind, np.maximum(follow, limit), np.inf).min(axis=1)
        return np.minimum(behind, giving)

    def lane_ends(self, state: State) -> Floats:
        """Free metres ``[N]`` to the end of a lane that does not go on along the route."""
        return self._routes.room[state.route, state.lane] - state.s - state.length / 2


def _neighbours(state: State, i: int, among: Floats) -> tuple[tuple[int, float], tuple[int, float]]:
    """The nearest vehicles ahead and behind and the gaps to them; NOWHERE and inf if there is none."""
    along = state.xy[:, 0] - state.xy[i, 0]
    gap = np.abs(along) - (state.length + state.length[i]) / 2
    found = []
    for side in (along >= 0, along < 0):
        distance = np.where(among & side, gap, np.inf)
        j = int(np.argmin(distance))
        found.append((j, float(distance[j])) if np.isfinite(distance[j]) else (NOWHERE, np.inf))
    return found[0], found[1]


def _follow(state: State, i: int, wanted: Floats, j: int, gap: float) -> float:
    """Acceleration of vehicle i behind vehicle j."""
    temper = state.temper[i]
    free = float(free_acceleration(state.speed[i], wanted[i], temper))
    if j == NOWHERE:
        return free
    return free - float(braking(state.speed[i], np.asarray(gap), state.speed[j], temper))
