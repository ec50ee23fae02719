"""highway-env's road, network and IDM vehicle with the same states, bit for bit, in a fraction of the time.

While a road acts, nobody moves: `Frozen` holds what can be computed once for that time. Arrays only sort out the clear
cases (see `lanes_fast`); whatever enters a state comes from the same scalar operations as in highway-env.

Importing this module imports highway_env (matplotlib, pandas, pygame: about 1 s), so import it where it is needed.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
from highway_env.road.road import Road
from highway_env.utils import not_zero, wrap_to_pi
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import Landmark

from ...types import Floats
from .lanes_fast import CLEAR, LaneIndex, LaneTable
from .lanes_fast import FastNetwork as FastNetwork


def snap(vehicle: Any) -> None:
    """Rounds position, heading and speed of a vehicle to 1e-6 m, rad and m/s, in place.

    Done after every step it removes what differs between processors in the last bits, before it grows. Zeros lose their
    sign, which would tell the two ends of a circle apart.
    """
    vehicle.position = np.array([round(float(value), 6) + 0.0 for value in vehicle.position])
    vehicle.heading = round(float(vehicle.heading), 6) + 0.0
    vehicle.speed = round(float(vehicle.speed), 6) + 0.0


class Frozen:
    """What is known about the vehicles and objects of a road while they stand still."""

    def __init__(self, table: LaneTable, bodies: Sequence[Any], connected: bool) -> None:
        self._table, self._bodies, self._connected = table, bodies, connected
        self._numbers = {body: i for i, body in enumerate(bodies)}
        xy = np.array([body.position for body in bodies], dtype=np.float64).reshape(-1, 2)
        s, r = table.coordinates(xy)
        on, unsure = table.on_lane(s, r, xy)
        marks = [i for i, body in enumerate(bodies) if isinstance(body, Landmark)]
        if marks:
            on[:, marks] = False
        self._s: list[list[float]] = s.tolist()
        self._unsure: list[bool] = unsure.tolist()
        self._on: list[list[int]] = [[] for _ in self._s]
        for row, i in np.argwhere(on).tolist():
            self._on[row].append(i)
        self._queues: dict[LaneIndex, tuple[list[float], list[int]] | None] = {}
        self._coordinates: dict[tuple[Any, Any], tuple[float, float]] = {}
        self._directions: dict[Any, Floats] = {}

    def coordinates(self, lane: Any, body: Any) -> tuple[float, float]:
        """Exact longitudinal and lateral coordinates m of a body on a lane; kept for bodies of the road only."""
        key = (lane, body)
        found = self._coordinates.get(key)
        if found is None:
            s, r = lane.local_coordinates(body.position)
            found = (s, r)
            if body in self._numbers:
                self._coordinates[key] = found
        return found

    def direction(self, body: Any) -> Floats | None:
        """The known unit vector [2] of a body's heading."""
        return self._directions.get(body)

    def keep_direction(self, body: Any, direction: Floats) -> Floats:
        """Remembers a direction, read-only, if the body is one of the road's."""
        if body in self._numbers:
            direction.flags.writeable = False
            self._directions[body] = direction
        return direction

    def is_clearly_before(self, lane: Any, body: Any, longitudinal: float) -> bool:
        """Whether a body surely has not reached a longitudinal coordinate m on a lane."""
        row, i = self._table.rows.get(lane), self._numbers.get(body)
        return row is not None and i is not None and self._s[row][i] < longitudinal - CLEAR

    def neighbours(self, vehicle: Any, index: LaneIndex) -> tuple[Any, Any] | None:
        """Vehicles or objects before and behind a vehicle on a lane, or None where the arrays cannot tell."""
        i = self._numbers.get(vehicle)
        queue = self._queue(index) if i is not None else None
        if i is None or queue is None:
            return None
        values, numbers = queue
        own = self._s[self._table.links(index, False)[0][0]][i]
        k = bisect_left(values, own)
        before = [n for n in range(max(k - 3, 0), k) if numbers[n] != i][-2:]
        ahead = [n for n in range(k, min(k + 3, len(values))) if numbers[n] != i][:2]
        around = [*(values[n] for n in before), own, *(values[n] for n in ahead)]
        if any(b - a < CLEAR for a, b in pairwise(around)):
            return None
        return self._bodies[numbers[ahead[0]]] if ahead else None, self._bodies[numbers[before[-1]]] if before else None

    def _queue(self, index: LaneIndex) -> tuple[list[float], list[int]] | None:
        """Longitudinal coordinates m, ascending, and numbers of all bodies on a lane and the lanes linked to it."""
        if index not in self._queues:
            self._queues[index] = self._line_up(index) if index in self._table.places else None
        return self._queues[index]

    def _line_up(self, index: LaneIndex) -> tuple[list[float], list[int]] | None:
        places: dict[int, float] = {}
        for row, offset in self._table.links(index, self._connected):
            if self._unsure[row]:
                return None
            for i in self._on[row]:
                places.setdefault(i, self._s[row][i] + offset)
        line = sorted(zip(places.values(), places.keys(), strict=True))
        return [value for value, _ in line], [i for _, i in line]


class FastRoad(Road):  # type: ignore[misc]
    """A road whose vehicles share lane coordinates while they act, and lane search and collision checks in a step.

    A network that is no `FastNetwork` is wrapped in one (`road.network`); `FastVehicle` gains most, other vehicles keep
    their states too. Vehicles and objects may come, go and change between calls.
    """

    network: FastNetwork

    def __init__(self, network: Any, *args: Any, **kwargs: Any) -> None:
        super().__init__(network if isinstance(network, FastNetwork) else FastNetwork.of(network), *args, **kwargs)
        self.still: Frozen | None = None  # while nobody moves
        self.moved: list[Any] | None = None  # during a step: vehicles whose lane is not yet known

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Makes queries fast while no vehicle or object moves, comes or goes.

        `act` does so by itself; rules of the road that run before it may do so too.
        """
        if self.still is not None:
            yield
            return
        bodies = [*self.vehicles, *self.objects]
        self.still = Frozen(self.network.table(), bodies, self.neighbour_vehicles_connected_lanes)
        try:
            yield
        finally:
            self.still = None

    def act(self) -> None:
        """Lets every vehicle decide."""
        with self.frozen():
            super().act()

    def step(self, dt: float) -> None:
        """Moves every vehicle by dt seconds, finds its lane, then looks for collisions."""
        table = self.network.table()
        self.moved = None if self.record_history else []
        try:
            for vehicle in self.vehicles:
                vehicle.step(dt)
            if self.moved:
                positions = np.array([vehicle.position for vehicle in self.moved], dtype=np.float64)
                headings = np.array([vehicle.heading for vehicle in self.moved], dtype=np.float64)
                for vehicle, index in zip(self.moved, table.closest(positions, headings), strict=True):
                    vehicle.lane_index, vehicle.lane = index, self.network.get_lane(index)
        finally:
            self.moved = None
        for one, other in close_pairs(self.vehicles, self.objects, dt):
            one.handle_collisions(other, dt)

    def neighbour_vehicles(self, vehicle: Any, lane_index: LaneIndex | None = None) -> tuple[Any, Any]:
        """The vehicles or objects before and behind a vehicle on a lane (its own if not given), None where none is."""
        index = lane_index or vehicle.lane_index
        found = self.still.neighbours(vehicle, index) if self.still is not None and index else None
        return super().neighbour_vehicles(vehicle, index) if found is None else found


def close_pairs(vehicles: Sequence[Any], objects: Sequence[Any], dt: float) -> list[tuple[Any, Any]]:
    """Pairs that may touch within dt seconds: vehicles first, then objects, in the order of `Road.step`."""
    bodies = [*vehicles, *objects]
    if not vehicles:
        return []
    xy = np.array([body.position for body in bodies], dtype=np.float64)
    half = np.array([body.diagonal for body in bodies]) / 2
    reach = np.array([body.speed * dt for body in vehicles]) + CLEAR
    dx, dy = xy.T[:, : len(vehicles), None] - xy.T[:, None, :]
    limit = half[: len(vehicles), None] + half + reach[:, None]
    near = np.triu((dx * dx + dy * dy <= limit * limit) & (limit > 0), 1)
    return [(bodies[i], bodies[j]) for i, j in np.argwhere(near).tolist()]


class FastVehicle(IDMVehicle):  # type: ignore[misc]
    """An IDM vehicle for a `FastRoad`.

    In `FastRoad.step`, ``lane`` and ``lane_index`` are set after all vehicles moved, not within the vehicle's `step`.
    """

    def on_state_update(self) -> None:
        """Finds the lane of the new position, or leaves it to the road that is moving everybody."""
        waiting = getattr(self.road, "moved", None)
        if waiting is None:
            super().on_state_update()
        else:
            waiting.append(self)

    @property
    def _still(self) -> Frozen | None:
        return getattr(self.road, "still", None)

    @property
    def direction(self) -> Floats:
        """Unit vector [2] of the heading."""
        still = self._still
        if still is None:
            found: Floats = super().direction
            return found
        known = still.direction(self)
        return still.keep_direction(self, super().direction) if known is None else known

    def lane_distance_to(self, other: Any, lane: Any = None) -> float:
        """Signed distance m along a lane (its own if not given) to another vehicle or object."""
        still, lane = self._still, lane or self.lane
        if still is None or not other:
            return float(super().lane_distance_to(other, lane))
        return still.coordinates(lane, other)[0] - still.coordinates(lane, self)[0]

    def follow_road(self) -> None:
        """Switches to the next lane at the end of a lane."""
        lane = self.road.network.get_lane(self.target_lane_index)
        still = self._still
        if still is None or not still.is_clearly_before(lane, self, lane.length - lane.VEHICLE_LENGTH / 2):
            super().follow_road()

    def steering_control(self, target_lane_index: LaneIndex) -> float:
        """Steering angle rad towards the middle of a lane: the stock controller without `np.clip`, slow on scalars."""
        lane, still = self.road.network.get_lane(target_lane_index), self._still
        s, r = lane.local_coordinates(self.position) if still is None else still.coordinates(lane, self)
        speed = not_zero(self.speed)
        approach = _within(np.arcsin(_within(-self.KP_LATERAL * r / speed, 1.0)), np.pi / 4)
        reference = lane.heading_at(s + self.speed * self.TAU_PURSUIT) + approach
        rate = self.KP_HEADING * wrap_to_pi(reference - self.heading)
        slip = np.arcsin(_within(self.LENGTH / 2 / speed * rate, 1.0))
        return _within(np.arctan(2 * np.tan(slip)), self.MAX_STEERING_ANGLE)


def _within(value: Any, limit: float) -> float:
    return min(max(float(value), -limit), limit)
