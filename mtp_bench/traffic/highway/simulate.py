"""Simulation of a world from a seed: traffic warms up and is recorded; worlds with a crash are rejected."""

from functools import lru_cache

import numpy as np

from ...core import Bools, DataError, Floats, Ints, Lane
from .behaviour import DriverBehaviour, PedestrianBehaviour
from .conflicts import Passage, find_passages
from .driving import (
    Fleet,
    RoadState,
    braking,
    desired_speed,
    find_leaders,
    steering_angles,
)
from .lane_change import LaneChanges
from .lanes import RouteTable, lane_map, route_table
from .networks import RoadMap, build_map
from .pedestrians import Crowd
from .recording import Recording
from .right_of_way import RightOfWay
from .vehicles import Driver, Entries, draw_parked_boxes, move_vehicles, vehicle_boxes
from .world import RATE, WARM_UP, ScenarioName, Traffic, World

ATTEMPTS = 50
HARDEST = 8.0  # m/s2, emergency braking
_LINE_GAP = 0.4  # m to a line
_JERK = (15.0, 5.0)  # m/s3, while braking and while accelerating


def simulate_world(traffic: Traffic, seed: int) -> World:
    """Simulate crash-free traffic of ``traffic.seconds`` seconds: the same scene for the same seed.

    Machines differ in last bits, so states are rounded. Sub-seeds are tried until one has no "crash" (two true boxes
    overlap) and, for a sensor on a vehicle, no "no_ego" (none is present all the time). DataError after `ATTEMPTS`.
    """
    rejected: list[str] = []
    for attempt in range(ATTEMPTS):
        world = Attempt(traffic, seed, attempt).run()
        if isinstance(world, World):
            return world
        rejected.append(world)
    reasons = ", ".join(
        f"{rejected.count(reason)} x {reason}" for reason in sorted(set(rejected))
    )
    raise DataError(
        f"{traffic.scenario}, seed {seed}: all {ATTEMPTS} attempts were rejected ({reasons}); expected a crash-free "
        f"scene: ask for fewer vehicles than {traffic.vehicles}, fewer seconds than {traffic.seconds:g} or another seed"
    )


@lru_cache(maxsize=8)
def _map_of(
    scenario: ScenarioName, seconds: float
) -> tuple[RoadMap, RouteTable, tuple[Passage, ...], tuple[Lane, ...]]:
    road_map = build_map(scenario, seconds)
    routes = route_table(road_map.routes, road_map.geometry)
    passages = find_passages(road_map, routes) if road_map.regulated else ()
    return road_map, routes, passages, lane_map(road_map.network.lanes_dict())


class Attempt:
    """One run of the traffic, step by step."""

    def __init__(self, traffic: Traffic, seed: int, attempt: int) -> None:
        self._traffic = traffic
        self.shared = _map_of(traffic.scenario, traffic.seconds)  # never changes
        self.map, self.routes, passages, self.lanes = self.shared
        generators = (np.random.default_rng([seed, attempt, kind]) for kind in range(6))
        entries, people, self._rng, parking, driving, walking = generators
        self.parked = draw_parked_boxes(self.map.kerbs, traffic.parked, parking)
        self.crowd = Crowd(
            self.map,
            traffic.pedestrians,
            people,
            PedestrianBehaviour(1.0 / RATE, walking),
        )
        self.drivers = _Drivers(
            self.map,
            self.routes,
            passages,
            self.crowd,
            DriverBehaviour(1.0 / RATE, driving),
        )
        self.vehicles = self.drivers.vehicles  # on the road
        self._entries = Entries(self.map, traffic.vehicles, self.vehicles, entries)
        self._entries.fill()
        self._steps = 0

    def boxes(self) -> tuple[Floats, Floats, Floats]:
        """Boxes ``[N, 7]`` of vehicles, people on foot and parked cars, in highway-env's frame."""
        return vehicle_boxes(self.vehicles), self.crowd.boxes(), self.parked

    def step(self, vehicles: Floats) -> None:
        """Move everybody by 1 / `RATE` seconds; ``vehicles`` ``[N, 7]``: their boxes now."""
        finished = self.drivers.step(
            self._steps, np.concatenate([vehicles, self.parked])
        )
        self._entries.admit(finished)
        self._steps += 1

    def run(self) -> World | str:
        """The recorded world, or the problem in one word."""
        frames = round(self._traffic.seconds * RATE)
        warm_up = round(WARM_UP * RATE)
        recording = Recording(self.parked)
        for step in range(warm_up + frames):
            vehicles, people, parked = self.boxes()
            if len(
                overlapping(np.concatenate([vehicles, people, parked]), len(parked))
            ):
                return "crash"
            if step >= warm_up:
                recording.add(self.vehicles, vehicles, self.crowd, people)
            self.step(vehicles)
        sensor = None if self._traffic.sensor == "ego" else self.map.sensor
        return recording.world(sensor, self.lanes, self._rng)


class _Drivers:
    """All drivers: they give way, make room for each other and wait for people on foot."""

    def __init__(
        self,
        road_map: RoadMap,
        routes: RouteTable,
        passages: tuple[Passage, ...],
        crowd: Crowd,
        behaviour: DriverBehaviour,
    ) -> None:
        self._map, self._routes, self._crowd, self._behaviour = (
            road_map,
            routes,
            crowd,
            behaviour,
        )
        self.vehicles: list[Driver] = []
        self.rules = (
            RightOfWay(passages, road_map.first_in_first_out)
            if road_map.regulated
            else None
        )
        self._changes = LaneChanges(road_map, routes) if road_map.overtaking else None
        self._fleet = Fleet([], 0, road_map.geometry)

    def step(self, step: int, obstacles: Floats) -> list[Driver]:
        """Move all drivers and people by 1 / `RATE` seconds; returns drivers at the end of their route.

        ``obstacles`` ``[N, 7]``: boxes that people on foot walk around.
        """
        people, velocity = self._crowd.xy()
        if (
            self._fleet.vehicles != self.vehicles
            or self._fleet.people != people.shape[1]
        ):
            self._fleet = Fleet([*self.vehicles], people.shape[1], self._map.geometry)
        state = RoadState(self._fleet, self._map, self._routes, people, velocity)
        acceleration = self._acceleration(state, step)
        angle = steering_angles(state, self._map.geometry, self._routes, 1.0 / RATE)
        move_vehicles(state.vehicles, state, angle, acceleration)
        if self.rules is not None:
            self._crowd.step(1.0 / RATE, obstacles, self.rules.free_to_walk)
        return [state.vehicles[i] for i in np.flatnonzero(state.finished)]

    def _acceleration(self, state: RoadState, step: int) -> Floats:
        geometry, routes, style = self._map.geometry, self._routes, state.style
        ahead = find_leaders(state, geometry)
        desired, free = self._behaviour.free_acceleration(state, desired_speed(state))
        result: Floats = free - braking(state.speed, ahead.gap, ahead.speed, style)
        lines = np.full(len(state), np.inf)
        if self.rules is not None:
            lines = self.rules.update(
                state, ahead, self._crowd.walks(), self._crowd.claimed(), step / RATE
            )
        if self._changes is not None:
            lines = (
                routes.room[state.route, state.lane] - state.s - state.length / 2
            )  # to the end of a lane
            result = np.minimum(result, self._changes.bounds(state, desired))
            self._changes.decide(state, desired, step, 1.0 / RATE)
        result = np.minimum(
            result, free - braking(state.speed, lines, np.zeros(1), style, _LINE_GAP)
        )
        result = self._behaviour.braking(state, result, free, ahead, lines)
        result = np.maximum(result, state.acceleration - _JERK[0] / RATE)
        result = np.minimum(result, state.acceleration + _JERK[1] / RATE)
        least = np.maximum(-HARDEST, -state.speed * RATE)  # no vehicle drives backwards
        return np.asarray(np.maximum(result, least))


def overlapping(box: Floats, still: int = 0) -> Ints:
    """Pairs ``[n, 2]`` of rows of boxes ``[N, 7]`` that overlap in bird's eye view; the last ``still`` are apart."""
    x, y, reach = box[:, 0], box[:, 1], np.hypot(box[:, 4], box[:, 5]) / 2
    moving = slice(len(box) - still)
    dx, dy = x[moving, None] - x, y[moving, None] - y
    pairs = np.stack(
        np.nonzero(dx * dx + dy * dy < (reach[moving, None] + reach) ** 2), axis=1
    )
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    if len(pairs) == 0:
        return pairs
    return pairs[boxes_meet(box[pairs[:, 0]], box[pairs[:, 1]])]


def boxes_meet(a: Floats, b: Floats) -> Bools:
    """Mask ``[n]`` of boxes a and b, both ``[n, 7]``, that overlap in bird's eye view."""
    meets = ~_separated(a, b)
    meets[meets] = ~_separated(b[meets], a[meets])
    return meets


def _separated(a: Floats, b: Floats) -> Bools:
    """Mask ``[n]`` of boxes a ``[n, 7]`` with an axis that separates them from boxes b."""
    cos, sin = np.cos(a[:, 3]), np.sin(a[:, 3])
    x, y = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    turn = b[:, 3] - a[:, 3]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    along = (a[:, 4] + c * b[:, 4] + s * b[:, 5]) / 2
    across = (a[:, 5] + s * b[:, 4] + c * b[:, 5]) / 2
    return (np.abs(cos * x + sin * y) > along) | (np.abs(cos * y - sin * x) > across)
