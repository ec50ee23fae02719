"""Ways through a road network: what follows what, which lanes lie beside which, where a lane ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Bools, Floats, Ints
from .lane_geometry import JOINT, LaneGeometry

REACH = 5  # lanes that a driver looks ahead, the present one included
NOWHERE = -1


@dataclass(frozen=True)
class Route:
    """A way from an entry to an exit: the lanes (numbers in the table) that may be used on each road of it."""

    roads: tuple[tuple[int, ...], ...]
    weight: float = 1.0  # how often it is chosen
    heavy: bool = True  # long vehicles may take it
    otherwise: int = NOWHERE  # route to continue on if the exit is missed


@dataclass(frozen=True, eq=False)
class RouteTable:
    """What every route says about every lane: arrays ``[routes, lanes, ...]``, `NOWHERE` where there is nothing."""

    following: Ints  # the next lane
    left: Ints
    right: Ints
    hops: Floats  # lane changes that are needed to stay on the route; inf: the lane is not part of it
    room: Floats  # m from the lane's start to where the route cannot be followed in this lane; inf: it can
    start: Floats  # m from the start of the route
    last: Bools  # the lane belongs to the last road of the route
    path: Ints  # [routes, lanes, REACH] the lanes ahead, the lane itself first
    path_start: Floats  # [routes, lanes, REACH] m from the lane's start to theirs


def tabulate(routes: tuple[Route, ...], table: LaneGeometry) -> RouteTable:
    """The table of ``routes`` through the lanes of ``table``."""
    shape = (len(routes), len(table))
    following, left, right = (np.full(shape, NOWHERE) for _ in range(3))
    last = np.zeros(shape, dtype=bool)
    start = np.zeros(shape)
    for r, route in enumerate(routes):
        for e, road in enumerate(route.roads):
            for k, lane in enumerate(road):
                left[r, lane] = road[k - 1] if k > 0 else NOWHERE
                right[r, lane] = road[k + 1] if k + 1 < len(road) else NOWHERE
                last[r, lane] = e + 1 == len(route.roads)
                if not last[r, lane]:
                    following[r, lane] = _continuation(lane, route.roads[e + 1], table)
                    for after in route.roads[e + 1]:
                        start[r, after] = start[r, lane] + table.length[lane]
    hops, room = _obligations(routes, table, following, left, right)
    path, path_start = _paths(following, table.length)
    return RouteTable(following, left, right, hops, room, start, last, path, path_start)


def _continuation(lane: int, road: tuple[int, ...], table: LaneGeometry) -> int:
    end = table.lanes[lane].position(table.length[lane], 0.0)
    for after in road:
        if np.linalg.norm(table.lanes[after].position(0.0, 0.0) - end) < JOINT:
            return after
    return NOWHERE


def _obligations(
    routes: tuple[Route, ...], table: LaneGeometry, following: Ints, left: Ints, right: Ints
) -> tuple[Floats, Floats]:
    """Lane changes that are needed, and the metres until the first of them must have happened."""
    hops, room = np.full(following.shape, np.inf), np.full(following.shape, np.inf)
    for r, route in enumerate(routes):
        for e in reversed(range(len(route.roads))):
            road = route.roads[e]
            for lane in road:
                after = following[r, lane]
                if e + 1 == len(route.roads):
                    hops[r, lane] = 0
                elif after == NOWHERE:
                    room[r, lane] = table.length[lane]
                else:
                    hops[r, lane], room[r, lane] = hops[r, after], table.length[lane] + room[r, after]
            for _ in road:
                for lane in road:
                    beside = [side[r, lane] for side in (left, right) if side[r, lane] != NOWHERE]
                    hops[r, lane] = min([hops[r, lane], *(hops[r, b] + 1 for b in beside)])
    return hops, room


def _paths(following: Ints, length: Floats) -> tuple[Ints, Floats]:
    path, start = np.full((*following.shape, REACH), NOWHERE), np.zeros((*following.shape, REACH))
    path[..., 0] = np.arange(following.shape[1])
    for k in range(1, REACH):
        before = path[..., k - 1]
        path[..., k] = np.where(before != NOWHERE, np.take_along_axis(following, before, axis=1), NOWHERE)
        start[..., k] = np.where(before != NOWHERE, start[..., k - 1] + length[before], 0.0)
    return path, start
