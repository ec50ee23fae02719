"""highway-env's own drivers, IDM and MOBIL, on the maps of this package: another kind of driver to test an agent on.

Treiber, Hennecke, Helbing (2000) for IDM; Kesting, Treiber, Helbing (2007) for MOBIL. They know no right of way, so
they are not for junctions, and they make no room for each other: some miss their exit, some wait where a ramp ends.
"""

from __future__ import annotations

from math import copysign, isinf
from typing import Any

import numpy as np
from highway_env.vehicle.objects import Obstacle

from .driver import Entry
from .lanes_fast import LaneIndex
from .networks import RoadMap
from .road import FastRoad, FastVehicle, snap
from .routes import NOWHERE, RouteTable
from .world import RATE

_AHEAD = 260.0  # m before the last chance, times the changes needed: from here on a change is necessary
_TOO_LATE = 60.0  # m: who is not in the exit lane by then drives on
_CLOSE = 0.1  # m, smaller gaps count as this
_AT_END = 1.0  # m
_SAFE = 2.0  # m/s2 of braking by IDM that a change may ask for, as in highway-env
_NEEDED = 12.0  # the same for a necessary change: some 10 m behind at 20 m/s; what is braked is never more than ACC_MAX


class IDMTraffic:
    """All vehicles of a map without junctions; highway-env decides what they do."""

    def __init__(self, town: RoadMap, routes: RouteTable, rng: np.random.Generator) -> None:
        self._ways, self._rng = _Ways(town, routes), rng
        generator: Any = rng
        self.road: Any = FastRoad(town.network, np_random=generator, neighbour_vehicles_connected_lanes=True)
        for k in np.flatnonzero((routes.following == NOWHERE).all(axis=0) & ~routes.last.any(axis=0)):
            lane = town.geometry.lanes[k]
            barrier = Obstacle(self.road, lane.position(lane.length, 0.0))  # else vehicles drive on where a ramp ends
            barrier.check_collisions = False
            self.road.objects.append(barrier)

    def make(self, entry: Entry) -> IDMDriver:
        """A vehicle that comes in; the road does not have it yet."""
        vehicle = IDMDriver(self.road, entry, self._ways, self._rng)
        snap(vehicle)
        return vehicle

    def step(self, step: int, vehicle_boxes: object) -> list[IDMDriver]:
        """Moves everybody by 1 / `RATE` seconds; gives those who are at the end of their route."""
        self.road.act()
        self.road.step(1.0 / RATE)
        for vehicle in self.road.vehicles:
            snap(vehicle)
        return [vehicle for vehicle in self.road.vehicles if vehicle.finished]


class _Ways:
    """What is known about routes, by highway-env's lane indices."""

    def __init__(self, town: RoadMap, table: RouteTable) -> None:
        self.index, self.routes = town.geometry.index, town.routes
        self._number, self._limit, self._table = town.geometry.number, town.geometry.limit, table

    def plan(self, route: int, start: str) -> list[tuple[str, str, int | None]]:
        """A route as highway-env has it: its roads from node ``start`` on, in any lane."""
        roads = [self.index[lanes[0]][:2] for lanes in self.routes[route].roads]
        return [(a, b, None) for a, b in roads[[a for a, _ in roads].index(start) :]]

    def fastest(self, route: int) -> float:
        """The highest limit on a route, m/s."""
        return max(float(self._limit[lanes[0]]) for lanes in self.routes[route].roads)

    def hops(self, route: int, index: LaneIndex) -> float:
        """Lane changes that are needed; inf: the lane is not part of the route."""
        return float(self._table.hops[route, self._number[index]])

    def room(self, route: int, index: LaneIndex) -> float:
        """Metres from a lane's start to where the route cannot be followed in this lane; inf: it can."""
        return float(self._table.room[route, self._number[index]])

    def is_last(self, route: int, index: LaneIndex) -> bool:
        """Whether the lane belongs to the last road of the route."""
        return bool(self._table.last[route, self._number[index]])


class IDMDriver(FastVehicle):
    """An IDM vehicle with a size, a temper and a route.

    Gaps are from bumper to bumper, nobody drives backwards, and MOBIL chooses among the lanes that belong to the route.
    highway-env's collision handling is off, as for `Driver`.
    """

    action: Any
    speed: Any

    def __init__(self, road: Any, entry: Entry, ways: _Ways, rng: np.random.Generator) -> None:
        p, lane = entry.profile, ways.index[entry.lane]
        timer = float(rng.uniform(0.0, self.LANE_CHANGE_DELAY))
        speed = min(p.pace * ways.fastest(entry.route), p.top_speed)
        super().__init__(road, entry.position, entry.heading, entry.speed, lane, speed, timer=timer)
        self.profile, self.number = p, entry.number
        self._ways, self._way = ways, entry.route
        self.route = ways.plan(entry.route, lane[0])
        self.check_collisions = False
        self.LENGTH, self.WIDTH = p.length, p.width
        self.diagonal = float(np.hypot(p.length, p.width))
        self.TIME_WANTED, self.DISTANCE_WANTED = p.time_gap, p.min_gap
        self.COMFORT_ACC_MAX, self.COMFORT_ACC_MIN = p.acceleration, -p.braking
        self.DELTA = float(rng.uniform(self.DELTA_RANGE[0], self.DELTA_RANGE[1]))

    @property
    def finished(self) -> bool:
        """Whether the route is over."""
        return self._ways.is_last(self._way, self.lane_index) and self._along(self.lane) > self.lane.length - _AT_END

    def act(self, action: Any = None) -> None:
        """Decides as highway-env does, but brakes to a stop at most."""
        super().act(action)
        self.action["acceleration"] = max(float(self.action["acceleration"]), -self.speed * RATE)

    def lane_distance_to(self, other: Any, lane: Any = None) -> float:
        """Signed gap m along a lane, from bumper to bumper."""
        distance = super().lane_distance_to(other, lane)
        return copysign(max(abs(distance) - (self.LENGTH + other.LENGTH) / 2, _CLOSE), distance)

    def follow_road(self) -> None:
        """Switches to the next lane at the end of a lane; plans anew where the exit is missed."""
        instead = self._ways.routes[self._way].otherwise
        if instead != NOWHERE and self._left(self.target_lane_index) < _TOO_LATE:
            self._way, self.route = instead, self._ways.plan(instead, self.target_lane_index[0])
        super().follow_road()

    def mobil(self, lane_index: LaneIndex) -> bool:
        """Whether to change to a lane; the head of ``route`` tells highway-env if the change is necessary."""
        here = self.target_lane_index
        now, then = self._ways.hops(self._way, here), self._ways.hops(self._way, lane_index)
        if isinf(then) or (then >= now and self._left(lane_index) < _AHEAD * then):
            return False
        must = then < now and self._left(here) < _AHEAD * now
        self.route[:1] = [(*here[:2], lane_index[2] if must else None)]
        self.LANE_CHANGE_MAX_BRAKING_IMPOSED = _NEEDED if must else _SAFE
        return bool(super().mobil(lane_index))

    def _left(self, index: LaneIndex) -> float:
        return self._ways.room(self._way, index) - self._along(self.road.network.get_lane(index))

    def _along(self, lane: Any) -> float:
        return float(lane.local_coordinates(self.position)[0])
