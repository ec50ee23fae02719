"""highway-env's own drivers, IDM and MOBIL, on the maps of this package: another kind of driver to test an agent on.

Treiber, Hennecke, Helbing (2000) for IDM; Kesting, Treiber, Helbing (2007) for MOBIL. They know no right of way, so
there are none at junctions. What they are told per vehicle is its size, temper and route, and that a ramp ends.
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
_SAFE, _NEEDED = 2.0, 12.0  # m/s2
_AT_END = 1.0  # m


class IDMTraffic:
    """All vehicles of a map without junctions; highway-env decides what they do."""

    def __init__(self, town: RoadMap, routes: RouteTable, rng: np.random.Generator) -> None:
        self._ways, self._rng = _Ways(town, routes), rng
        self.road: Any = FastRoad(town.network, np_random=rng, neighbour_vehicles_connected_lanes=True)
        for lane in np.flatnonzero((routes.following == NOWHERE).all(axis=0) & ~routes.last.any(axis=0)):
            way = town.geometry.lanes[lane]
            barrier = Obstacle(self.road, way.position(way.length, 0.0))
            barrier.check_collisions = False
            self.road.objects.append(barrier)

    def make(self, entry: Entry) -> IDMDriver:
        """A vehicle with the temper of its profile."""
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
    """Routes by highway-env's lane indices."""

    def __init__(self, town: RoadMap, table: RouteTable) -> None:
        self._routes, self._limit, self._table = town.routes, town.geometry.limit, table
        self.index, self._number = town.geometry.index, town.geometry.number

    def plan(self, route: int, start: str) -> list[tuple[str, str, int | None]]:
        """A route as highway-env has it: its roads from node ``start`` on, in any lane."""
        roads = [self.index[lanes[0]][:2] for lanes in self._routes[route].roads]
        return [(a, b, None) for a, b in roads[[a for a, _ in roads].index(start) :]]

    def fastest(self, route: int) -> float:
        """The highest limit on a route, m/s."""
        return max(float(self._limit[lanes[0]]) for lanes in self._routes[route].roads)

    def instead(self, route: int) -> int:
        """The route of those who miss the exit of this one, or `NOWHERE`."""
        return self._routes[route].otherwise

    def hops(self, route: int, index: LaneIndex) -> float:
        """Lane changes that are needed; inf: the lane is not part of the route."""
        return float(self._table.hops[route, self._number[index]])

    def left(self, route: int, index: LaneIndex, s: float) -> float:
        """Metres from ``s`` in a lane to where the route cannot be followed in this lane; inf: it can."""
        return float(self._table.room[route, self._number[index]]) - s

    def ended(self, route: int, lane: Any, index: LaneIndex, s: float) -> bool:
        """Whether the route is over at ``s`` in a lane."""
        return bool(self._table.last[route, self._number[index]]) and s > lane.length - _AT_END


class IDMDriver(FastVehicle):
    """An IDM vehicle with a size, a temper and a route.

    Gaps are from bumper to bumper, nobody drives backwards, and MOBIL chooses among the lanes that belong to the route.
    highway-env's collision handling is off, as for `Driver`.
    """

    def __init__(self, road: Any, entry: Entry, ways: _Ways, rng: np.random.Generator) -> None:
        p, index = entry.profile, ways.index[entry.lane]
        timer = float(rng.uniform(0.0, self.LANE_CHANGE_DELAY))
        speed = min(p.pace * ways.fastest(entry.route), p.top_speed)
        super().__init__(road, entry.position, entry.heading, entry.speed, index, speed, timer=timer)
        self.profile, self.number = p, entry.number
        self._ways, self._way = ways, entry.route
        self.route = ways.plan(entry.route, index[0])
        self.check_collisions = False
        self.LENGTH, self.WIDTH = p.length, p.width
        self.diagonal = float(np.hypot(p.length, p.width))
        self.TIME_WANTED, self.DISTANCE_WANTED = p.time_gap, p.min_gap
        self.COMFORT_ACC_MAX, self.COMFORT_ACC_MIN = p.acceleration, -p.braking
        self.DELTA = float(rng.uniform(*self.DELTA_RANGE))

    @property
    def finished(self) -> bool:
        """Whether the route is over."""
        s, _ = self.lane.local_coordinates(self.position)
        return self._ways.ended(self._way, self.lane, self.lane_index, s)

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
        instead, here = self._ways.instead(self._way), self.target_lane_index
        if instead != NOWHERE and self._ways.left(self._way, here, self._along(here)) < _TOO_LATE:
            self._way, self.route = instead, self._ways.plan(instead, here[0])
        super().follow_road()

    def mobil(self, lane_index: LaneIndex) -> bool:
        """Whether to change to a lane; ``route`` tells highway-env whether the change is necessary."""
        ways, way, here = self._ways, self._way, self.target_lane_index
        s, hops, fewest = self._along(here), ways.hops(way, lane_index), ways.hops(way, here)
        if isinf(hops):
            return False
        must = hops < fewest and ways.left(way, here, s) < _AHEAD * fewest
        if hops > 0 and hops >= fewest and ways.left(way, lane_index, s) < _AHEAD * hops:
            return False
        self.route[:1] = [(*here[:2], lane_index[2] if must else None)]
        self.LANE_CHANGE_MAX_BRAKING_IMPOSED = _NEEDED if must else _SAFE
        return bool(super().mobil(lane_index))

    def _along(self, index: LaneIndex) -> float:
        return float(self.road.network.get_lane(index).local_coordinates(self.position)[0])
