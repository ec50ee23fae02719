"""Simulation of a world from a seed: traffic warms up and is recorded.

Worlds with a crash are rejected.
"""

from collections import Counter
from functools import lru_cache

import numpy as np

from ...core import DataError, Floats, Lane, overlapping
from .behaviour import DriverBehaviour, PedestrianBehaviour
from .conflicts import Passage, find_passages
from .driving import RoadState, braking, desired_speed, find_leaders, steering_angles
from .lane_change import LaneChanges
from .lanes import RoadMap, RouteTable, lane_map, route_table
from .networks import build_map
from .pedestrians import Crowd
from .right_of_way import RightOfWay
from .vehicles import Driver, Entries, draw_parked_boxes, move_vehicles, vehicle_boxes
from .world import (
    CLASS_COLUMN,
    CLASSES,
    FRAME_COLUMN,
    NUMBER_COLUMN,
    RATE,
    WARM_UP,
    Recording,
    ScenarioName,
    Traffic,
    World,
    course_velocity,
)

ATTEMPTS = 50
RANDOM_KINDS = 6  # independent random numbers of an attempt
MAX_BRAKING_MPS2 = 8.0  # emergency braking
_LINE_GAP_M = 0.4  # to a line
_BRAKING_JERK_MPS3 = 15.0
_ACCELERATING_JERK_MPS3 = 5.0
# numbers of people and parked cars follow those of drivers
_FIRST_PERSON = 1_000_000
_FIRST_PARKED = 2_000_000
_CAR = CLASSES.index("car")
_MOTORCYCLE = CLASSES.index("motorcycle")
_PEDESTRIAN = CLASSES.index("pedestrian")
_EGO_CANDIDATES = 3  # among which the ego is drawn
_MIN_WAY_SHARE = 0.6  # of the longest way, for the ego
_AROUND_M = 60.0  # around the ego, within which objects count
Boxes = tuple[Floats, Floats, Floats]  # [N, 7] of vehicles, people and parked cars


def simulate_world(traffic: Traffic, seed: int) -> World:
    """Simulate crash-free traffic of ``traffic.seconds`` seconds.

    It is the same scene for the same seed: machines differ in last bits, so states are
    rounded. Sub-seeds are tried until one has no "crash" (two true boxes overlap) and,
    for a sensor on a vehicle, no "no_ego" (no vehicle is present all the time). Raises
    DataError after `ATTEMPTS`.
    """
    rejected: list[str] = []
    for number in range(ATTEMPTS):
        world = Attempt(traffic, seed, number).run()
        if isinstance(world, World):
            return world
        rejected.append(world)
    counts = sorted(Counter(rejected).items())
    reasons = ", ".join(f"{count} x {reason}" for reason, count in counts)
    raise DataError(
        f"{traffic.scenario}, seed {seed}: all {ATTEMPTS} attempts were rejected"
        f" ({reasons}); expected a crash-free scene: ask for fewer vehicles than"
        f" {traffic.vehicles}, fewer seconds than {traffic.seconds:g} or another seed"
    )


@lru_cache(maxsize=8)
def _map_of(
    scenario: ScenarioName, seconds: float
) -> tuple[RoadMap, RouteTable, tuple[Passage, ...], tuple[Lane, ...]]:
    """Return the map of worlds of ``seconds``, its routes, passages and lanes.

    Passages, the ways through a junction, are empty without rules of right of way.
    """
    road_map = build_map(scenario, seconds)
    routes = route_table(road_map.routes, road_map.geometry)
    passages = find_passages(road_map, routes) if road_map.regulated else ()
    return road_map, routes, passages, lane_map(road_map.geometry.network.lanes_dict())


class Attempt:
    """One run of the traffic, step by step.

    Drivers give way, make room for each other and wait for people on foot.
    """

    def __init__(self, traffic: Traffic, seed: int, attempt_number: int) -> None:
        self._traffic = traffic
        self.shared = _map_of(traffic.scenario, traffic.seconds)  # never changes
        self.map, self.routes, passages, self.lanes = self.shared
        # of their own for each part: a change of one does not move the others
        entries, people, self._rng, parking, driving, walking = (
            np.random.default_rng([seed, attempt_number, kind])
            for kind in range(RANDOM_KINDS)
        )
        self.parked = draw_parked_boxes(self.map.kerbs, traffic.parked, parking)
        pedestrians = PedestrianBehaviour(1.0 / RATE, walking)
        self.crowd = Crowd(self.map, traffic.pedestrians, people, pedestrians)
        self.vehicles: list[Driver] = []  # on the road
        self._behaviour = DriverBehaviour(1.0 / RATE, driving)
        self.rules: RightOfWay | None = None
        self._changes: LaneChanges | None = None
        if self.map.regulated:
            self.rules = RightOfWay(passages, self.map.first_in_first_out)
        else:
            self._changes = LaneChanges(self.map, self.routes)
        self._entries = Entries(self.map, traffic.vehicles, self.vehicles, entries)
        self._entries.fill()
        self._steps = 0

    def boxes(self) -> Boxes:
        """Return boxes in highway-env's frame."""
        return vehicle_boxes(self.vehicles), self.crowd.boxes(), self.parked

    def has_crash(self, boxes: Boxes) -> bool:
        """Return True if any boxes overlap."""
        return len(overlapping(np.concatenate(boxes), len(self.parked))) > 0

    def record(self, recording: Recording, boxes: Boxes) -> None:
        """Append the present frame to a recording."""
        parked = range(_FIRST_PARKED, _FIRST_PARKED + len(self.parked))
        people = self.crowd.people
        velocity = [
            course_velocity(self.vehicles),
            self.crowd.state().velocity.T,
            np.zeros((len(parked), 2)),
        ]
        class_id = [v.traits.class_id for v in self.vehicles]
        class_id += [_PEDESTRIAN] * len(people) + [_CAR] * len(parked)
        number = [v.number for v in self.vehicles]
        number += [_FIRST_PERSON + p.number for p in people]
        number += parked
        box = np.concatenate(boxes)
        recording.add(box, np.concatenate(velocity), class_id, number)

    def run(self) -> World | str:
        """Return the recorded world, or else "crash" or "no_ego"."""
        warm_up = round(WARM_UP * RATE)
        recording = Recording(RATE)
        for step in range(warm_up + round(self._traffic.seconds * RATE)):
            boxes = self.boxes()
            if self.has_crash(boxes):
                return "crash"
            if step >= warm_up:
                self.record(recording, boxes)
            self.step(boxes[0])
        if self._traffic.sensor == "roadside":
            return recording.seen_beside(self.map.sensor, self.lanes)
        ego = _choose_ego(recording, self._rng)
        return "no_ego" if ego is None else recording.seen_from(ego, self.lanes)

    def step(self, vehicles: Floats) -> None:
        """Move all by 1 / `RATE` seconds.

        ``vehicles`` [N, 7]: boxes of the vehicles now.
        """
        people = self.crowd.state()
        state = RoadState(
            [*self.vehicles], self.map, self.routes, people.xy, people.velocity
        )
        acceleration = self._acceleration(state)
        steering_rad = steering_angles(
            state, self.map.geometry, self.routes, 1.0 / RATE
        )
        move_vehicles(state.vehicles, state, steering_rad, acceleration)
        if self.rules is not None:
            obstacles = np.concatenate([vehicles, self.parked])
            self.crowd.step(1.0 / RATE, obstacles, self.rules.free_to_walk)
        self._entries.admit([state.vehicles[i] for i in np.flatnonzero(state.finished)])
        self._steps += 1

    def _acceleration(self, state: RoadState) -> Floats:
        """Return the accelerations [N] of all drivers, m/s2."""
        style = state.style
        ahead = find_leaders(state, self.map.geometry)
        desired, free_mps2 = self._behaviour.free_acceleration(
            state, desired_speed(state)
        )
        result_mps2: Floats = free_mps2 - braking(
            state.speed, ahead.gap, ahead.speed, style
        )
        line_distance_m = np.full(len(state), np.inf)
        if self.rules is not None:
            walks = self.crowd.walks()
            claimed = self.crowd.claimed()
            time_s = self._steps / RATE
            line_distance_m = self.rules.update(state, ahead, walks, claimed, time_s)
        if self._changes is not None:
            # a vehicle that must change lanes waits at the end of its lane
            room_m = self.routes.room[state.route, state.lane]
            line_distance_m = room_m - state.s - state.length / 2
            result_mps2 = np.minimum(result_mps2, self._changes.bounds(state, desired))
            self._changes.decide(state, desired, self._steps, 1.0 / RATE)
        standing = np.zeros(1)  # a line is a leader that stands
        for_line = braking(state.speed, line_distance_m, standing, style, _LINE_GAP_M)
        result_mps2 = np.minimum(result_mps2, free_mps2 - for_line)
        result_mps2 = self._behaviour.braking(
            state, result_mps2, free_mps2, ahead, line_distance_m
        )
        result_mps2 = np.maximum(
            result_mps2, state.acceleration - _BRAKING_JERK_MPS3 / RATE
        )
        result_mps2 = np.minimum(
            result_mps2, state.acceleration + _ACCELERATING_JERK_MPS3 / RATE
        )
        # no vehicle drives backwards
        lowest_mps2 = np.maximum(-MAX_BRAKING_MPS2, -state.speed * RATE)
        return np.asarray(np.maximum(result_mps2, lowest_mps2))


def _choose_ego(recording: Recording, rng: np.random.Generator) -> int | None:
    """Draw the number of the vehicle that carries the sensor.

    It drives far, has many objects around it and is present in all frames. None if
    there is no such vehicle.
    """
    rows = recording.rows()
    number = rows[:, NUMBER_COLUMN]
    frame = rows[:, FRAME_COLUMN].astype(np.int64)
    drives = ~np.isin(rows[:, CLASS_COLUMN], (_MOTORCYCLE, _PEDESTRIAN))
    drives &= number < _FIRST_PERSON  # parked cars have larger numbers
    candidates, count = np.unique(number[drives], return_counts=True)
    candidates = candidates[count == len(recording.frames)]
    if not len(candidates):
        return None
    way_m = np.empty(len(candidates))
    around = np.empty(len(candidates))  # share of all rows
    for i, candidate in enumerate(candidates):
        path = rows[number == candidate, :2]
        way_m[i] = np.hypot(*np.diff(path, axis=0).T).sum()
        around[i] = np.mean(np.hypot(*(rows[:, :2] - path[frame]).T) < _AROUND_M)
    # vehicles that hardly move come last
    preference = np.where(way_m >= _MIN_WAY_SHARE * way_m.max(), around, around - 1.0)
    best = np.argsort(-preference, kind="stable")[:_EGO_CANDIDATES]
    return int(candidates[best[int(rng.integers(len(best)))]])
