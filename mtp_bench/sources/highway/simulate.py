"""A world from a seed: traffic that flows for a while, then is recorded, and thrown away if anybody crashed."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from highway_env.road.road import Road

from ...errors import DataError
from ...types import Bools, Floats, Ints
from . import plans
from .conflicts import Passage, passages
from .following import HARDEST, braking, desired_speed, free_acceleration, leaders, steering
from .habits import Habits
from .lane_change import LaneChanges
from .lane_geometry import lane_map
from .moods import Moods
from .networks import RoadMap, build
from .parking import parked_boxes
from .pedestrians import Crowd
from .population import Driver, Gate, boxes, snap
from .recording import Recording
from .right_of_way import RightOfWay
from .routes import RouteTable, tabulate
from .state import State, observe
from .world import RATE, ScenarioName, Traffic, World

ATTEMPTS = 50
_AT_LINES = 0.4  # m that are kept to a line
_JERK = (15.0, 5.0)  # m/s3, how fast a driver brakes and accelerates


def simulate_world(traffic: Traffic, seed: int) -> World:
    """Crash-free traffic of ``traffic.seconds`` seconds; the same bits for the same seed, everywhere.

    Sub-seeds are tried in turn; what was wrong with those before the first good one is in ``World.rejected``: "crash"
    (two true boxes overlapped, in the warm-up or later) or "no_ego" (nobody was there all the time). Raises DataError
    when none of `ATTEMPTS` is good.
    """
    rejected: list[str] = []
    for attempt in range(ATTEMPTS):
        world = _Attempt(traffic, seed, attempt).run(tuple(rejected))
        if isinstance(world, World):
            return world
        rejected.append(world)
    reasons = ", ".join(f"{rejected.count(r)} x {r}" for r in sorted(set(rejected)))
    raise DataError(
        f"{traffic.scenario}, seed {seed}: all {ATTEMPTS} attempts were rejected ({reasons}); expected a crash-free "
        f"scene: ask for fewer vehicles than {traffic.vehicles}, fewer seconds than {traffic.seconds:g} or another seed"
    )


@lru_cache(maxsize=8)
def _town(scenario: ScenarioName, seconds: float) -> tuple[RoadMap, RouteTable, tuple[Passage, ...]]:
    town = build(scenario, seconds)
    routes = tabulate(town.routes, town.geometry)
    return town, routes, passages(town, routes) if town.regulated else ()


class _Attempt:
    """One run of the traffic."""

    def __init__(self, traffic: Traffic, seed: int, attempt: int) -> None:
        self._traffic = traffic
        places = _town(traffic.scenario, traffic.seconds)
        self._map = places[0]
        entries, people, self._rng, parking, driving, walking = (
            np.random.default_rng([seed, attempt, kind]) for kind in range(6)
        )
        self._parked = parked_boxes(self._map.kerbs, traffic.parked, parking)
        self._crowd = Crowd(self._map, traffic.pedestrians, people, Moods(1.0 / RATE, walking))
        self._drivers = _Drivers(*places, self._crowd, Habits(1.0 / RATE, driving))
        self._gate = Gate(self._map, traffic.vehicles, entries)

    def run(self, rejected: tuple[str, ...]) -> World | str:
        """The recorded world, or a word for what was wrong."""
        frames = round(self._traffic.seconds * RATE)
        warm_up = round(plans.WARM_UP * RATE)
        recording, road = Recording(frames, self._parked), self._drivers.road
        self._gate.fill(road)
        for step in range(warm_up + frames):
            vehicles, people = boxes(road.vehicles), self._crowd.boxes()
            if len(overlapping(np.concatenate([vehicles, people, self._parked]))):
                return "crash"
            if step >= warm_up:
                recording.add(road.vehicles, vehicles, self._crowd, people)
            self._gate.admit(road, self._drivers.step(step, np.concatenate([vehicles, self._parked])))
        sensor = None if self._traffic.sensor == "ego" else self._map.sensor
        return recording.world(sensor, lane_map(self._map.geometry), rejected, self._rng)


class _Drivers:
    """Drivers who give way, make room for each other and wait for people on foot."""

    def __init__(
        self, town: RoadMap, routes: RouteTable, conflicts: tuple[Passage, ...], crowd: Crowd, habits: Habits
    ) -> None:
        self._map, self._routes, self._crowd, self._habits = town, routes, crowd, habits
        unused: Any = np.random.default_rng(0)  # otherwise the road would make a generator with a seed from the clock
        self.road: Any = Road(network=town.network, np_random=unused)
        self._rules = RightOfWay(conflicts, town.first_in_first_out) if town.regulated else None
        self._changes = LaneChanges(town, routes) if town.overtaking else None

    def step(self, step: int, obstacles: Floats) -> list[Driver]:
        """Move everybody by 1 / `RATE` seconds; returns those who are at the end of their route.

        ``obstacles`` ``[N, 7]``: boxes that people on foot walk around.
        """
        state = observe(self.road.vehicles, self._map, self._routes, *self._crowd.xy())
        acceleration = self._acceleration(state, step)
        before = np.array([vehicle.action["steering"] for vehicle in state.vehicles])
        angle = steering(state, self._map.geometry, self._routes, before, 1.0 / RATE)
        for vehicle, turn, gas in zip(state.vehicles, angle.tolist(), acceleration.tolist(), strict=True):
            vehicle.act({"steering": turn, "acceleration": gas})
        self.road.step(1.0 / RATE)
        snap(state.vehicles)
        if self._rules is not None:
            self._crowd.step(1.0 / RATE, obstacles, self._rules.free_to_walk)
        return [state.vehicles[i] for i in np.flatnonzero(state.finished)]

    def _acceleration(self, state: State, step: int) -> Floats:
        geometry, routes = self._map.geometry, self._routes
        ahead = leaders(state, geometry, routes)
        wanted = self._habits.wanted(state, desired_speed(state, geometry, routes))
        free = self._habits.pedal(state, free_acceleration(state.speed, wanted, state.temper))
        result: Floats = free - braking(state.speed, ahead.gap, ahead.speed, state.temper)
        lines = np.full(len(state), np.inf)
        if self._rules is not None:
            crowd = self._crowd
            lines = self._rules.update(state, ahead, crowd.walks(), crowd.claimed(), step / RATE)
        if self._changes is not None:
            lines = self._changes.lane_ends(state)
            result = np.minimum(result, self._changes.bounds(state, wanted))
            self._changes.decide(state, wanted, step, 1.0 / RATE)
        result = np.minimum(result, free - braking(state.speed, lines, np.zeros(1), state.temper, _AT_LINES))
        result = self._habits.braking(state, result, free, ahead, lines)
        before = np.array([vehicle.action["acceleration"] for vehicle in state.vehicles])
        result = np.clip(result, before - _JERK[0] / RATE, before + _JERK[1] / RATE)
        least = np.maximum(-HARDEST, -state.speed * RATE)  # nobody drives backwards
        return np.asarray(np.maximum(result, least))


def overlapping(box: Floats) -> Ints:
    """Pairs ``[n, 2]`` of rows of boxes ``[N, 7]`` that overlap in bird's eye view (separating axes)."""
    if len(box) < 2:
        return np.empty((0, 2), dtype=np.int64)
    reach = np.hypot(box[:, 4], box[:, 5]) / 2
    dx, dy = box[:, 0, None] - box[:, 0], box[:, 1, None] - box[:, 1]
    pairs: Ints = np.argwhere(dx * dx + dy * dy < (reach[:, None] + reach) ** 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    if len(pairs) == 0:
        return pairs
    a, b = box[pairs[:, 0]], box[pairs[:, 1]]
    return pairs[~(_separated(a, b) | _separated(b, a))]


def _separated(a: Floats, b: Floats) -> Bools:
    """Whether an axis of box a ``[n, 7]`` separates it from box b: ``[n]`` bool."""
    cos, sin = np.cos(a[:, 3]), np.sin(a[:, 3])
    x, y = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    turn = b[:, 3] - a[:, 3]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    along = (a[:, 4] + c * b[:, 4] + s * b[:, 5]) / 2
    across = (a[:, 5] + s * b[:, 4] + c * b[:, 5]) / 2
    return (np.abs(cos * x + sin * y) > along) | (np.abs(cos * y - sin * x) > across)
