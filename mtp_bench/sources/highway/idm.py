"""highway-env's own drivers, IDM and MOBIL, on the maps of this package: another kind of driver to test an agent on.

Treiber, Hennecke, Helbing (2000) for IDM; Kesting, Treiber, Helbing (2007) for MOBIL. They know no right of way, so
there are none at junctions. What highway-env lacks is set per vehicle: a size, a temper, gaps from bumper to bumper,
lanes that belong to its route, and a ramp that ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.vehicle.objects import Obstacle

from .driver import Entry, Profile
from .networks import RoadMap
from .road import FastRoad, FastVehicle, snap
from .routes import NOWHERE, RouteTable
from .world import RATE

_AHEAD = 260.0  # m before the last chance, times the changes needed: from here on a change is necessary
_TOO_LATE = 60.0  # m: who is not in the exit lane by then drives on
_CLOSE = 0.1  # m, smaller gaps count as this


class IDMTraffic:
    """All vehicles of a map without junctions, on highway-env's road with its own decisions."""

    def __init__(self, town: RoadMap, routes: RouteTable, rng: np.random.Generator) -> None:
        self._ways, self._rng = Ways(town, routes), rng
        generator: Any = rng
        self.road: Any = FastRoad(town.network, np_random=generator, neighbour_vehicles_connected_lanes=True)
        for lane in self._ways.dead_ends:
            barrier = Obstacle(self.road, lane.position(lane.length, 0.0))
            barrier.check_collisions = False
            self.road.objects.append(barrier)

    def make(self, entry: Entry) -> IDMDriver:
        """A vehicle with a temper of its own."""
        vehicle = IDMDriver(self.road, entry, self._ways, self._rng)
        snap(vehicle)
        return vehicle

    def step(self, step: int, vehicle_boxes: object) -> list[IDMDriver]:
        """Moves everybody; gives those who are at the end of their route."""
        self.road.act()
        self.road.step(1.0 / RATE)
        for vehicle in self.road.vehicles:
            snap(vehicle)
        return [vehicle for vehicle in self.road.vehicles if vehicle.finished]


class Ways:
    """What routes say about lanes, by highway-env's lane indices."""

    def __init__(self, town: RoadMap, table: RouteTable) -> None:
        self.number, self.table, self._routes = town.geometry.number, table, town.routes
        self._index = town.geometry.index
        goes_on = {index[0] for index in self._index}
        ends = [k for k in range(len(self._index)) if (table.hops[:, k] > 0).any() and np.isfinite(table.room[:, k]).any()]
        self.dead_ends: list[Any] = []

    def roads(self, route: int, start: str) -> list[tuple[str, str, int | None]]:
        """highway-env's plan: the roads of a route from node ``start`` on, in any lane."""
        roads = [self._index[lanes[0]][:2] for lanes in self._routes[route].roads]
        return [(*road, None) for road in roads[[road[0] for road in roads].index(start) :]]
