"""Right of way at a junction: first come, first served, where routes conflict.

Near its line a vehicle asks for the right of way. It gets it if it will reach every
shared stretch after the vehicles that have it have left (or, if the map allows it, well
before they come), and if no pedestrian is in the way. Until then it stops at its line.
With the right of way it still waits before a stretch that is not free in time.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ...core import Floats
from .conflicts import ConflictZone, CrossingStretch, Passage
from .driving import ACCELERATION, Leaders, RoadState

# numbers of vehicles, each with a zone shared with it
Orders = list[tuple[int, ConflictZone]]
_ASK_DISTANCE_M = 14.0  # before the line, at which a vehicle asks, and more at speed
_ASK_TIME_S = 4.0
# time between two vehicles at a shared stretch
_AFTER_S = 0.6
_BEFORE_S = 0.5
# part of _AFTER_S that must remain, otherwise a vehicle with the right of way waits
_MIN_AFTER_S = 0.2
# waiting time after which no conflicting vehicle gets the right of way first
_PATIENCE_S = 6.0
# waiting time after which people who just came to a crossing let a vehicle go first
_COURTESY_S = 10.0
# distance from the middle of a vehicle's path to a pedestrian outside of it
_WALKER_GAP_M = 1.7
_WALKER_GAP_S = 1.0  # between a vehicle and a pedestrian
# a vehicle that stopped this far behind the line still waits
_OVERSHOT_M = 3.0
_SLOW_MPS = 1.0  # a slower vehicle may stay in its place
_INSIDE_M = 0.5  # a vehicle this far inside a stretch no longer waits before it
_STRETCH_GAP_M = 0.3  # before a crossing
# braking before a line: of the driven vehicle, and of others who see it come
_DRIVEN_BRAKING_MPS2 = 3.0
_OTHERS_BRAKING_MPS2 = 5.0
_FAST_ACCELERATION_MPS2 = 2.2
_FAST_CRUISE = 1.05  # share of the limit
_SLOW_ACCELERATION = 0.7  # share of the driver's
_SLOW_CRUISE = 0.85


@dataclass(frozen=True)
class CrossingPedestrian:
    """A pedestrian on a crossing, or about to step on it."""

    crossing: int
    along: float  # m along the crossing, from its origin
    direction: float  # +1 or -1
    speed: float
    patient: bool = False  # lets a vehicle go first that has waited long


@dataclass(slots=True)
class _Approach:
    """A vehicle on its way to the junction or through it."""

    passage: Passage
    route: int
    front: float  # m from the start of the route
    rear: float
    speed: float
    acceleration: float
    leader_gap_m: float  # to a slow leader
    wait_gap_m: float = math.inf  # to the place where it has to wait

    @property
    def behind_line(self) -> bool:
        """True if it can still wait at the line."""
        return self.front <= self.passage.line + _OVERSHOT_M

    def has_left(self, zone: ConflictZone) -> bool:
        """Return True if it has left the other stretch of a zone.

        On a common way it is enough to be ahead.
        """
        if zone.merging:
            return (self.front + self.rear) / 2 > zone.other_end
        return self.rear > zone.other_end

    def earliest_arrival_s(self, station_m: float) -> float:
        """Return how soon its front may reach a station of its route."""
        cruise_mps = _FAST_CRUISE * self.passage.cruise
        distance_m = station_m - self.front
        return _travel_time(distance_m, self.speed, _FAST_ACCELERATION_MPS2, cruise_mps)

    def latest_clearance_s(self, station_m: float) -> float:
        """Return how late its rear may pass a station of its route.

        Inf if it may stop before.
        """
        distance_m = station_m - self.rear
        if min(self.leader_gap_m, self.wait_gap_m) < distance_m:
            return math.inf
        acceleration_mps2 = _SLOW_ACCELERATION * self.acceleration
        cruise_mps = _SLOW_CRUISE * self.passage.cruise
        return _travel_time(distance_m, self.speed, acceleration_mps2, cruise_mps)

    def meets(self, stretch: CrossingStretch, walk: CrossingPedestrian) -> bool:
        """Return True if a pedestrian would be in the way.

        So it is if both may be at the crossing of their paths at the same time.
        """
        if walk.crossing != stretch.crossing or self.rear > stretch.end:
            return False
        # m to the middle of the vehicle's path, negative behind it
        to_middle = (stretch.across - walk.along) * walk.direction
        if to_middle < -_WALKER_GAP_M:
            return False
        # seconds from now, in which the pedestrian is near the vehicle's path
        enters = max(to_middle - _WALKER_GAP_M, 0.0) / walk.speed
        leaves = (to_middle + _WALKER_GAP_M) / walk.speed
        comes_before = (
            self.earliest_arrival_s(stretch.start) < leaves + _WALKER_GAP_S / 2
        )
        return (
            comes_before
            and enters < self.latest_clearance_s(stretch.end) + _WALKER_GAP_S
        )

    def meets_any(
        self, stretch: CrossingStretch, walks: list[CrossingPedestrian]
    ) -> bool:
        """Return True if any of the pedestrians would be in the way."""
        return any(self.meets(stretch, walk) for walk in walks)


@dataclass
class RightOfWay:
    """Granted rights of way, by vehicle number.

    ``driven``: number of a vehicle that cannot be told to wait; others let it pass
    where it cannot stop.
    """

    passages: tuple[Passage, ...]
    first_in_first_out: bool
    driven: int = -1
    # vehicles to let go first
    _granted: dict[int, Orders] = field(default_factory=dict)
    _asked_s: dict[int, float] = field(default_factory=dict)
    _vehicles: dict[int, _Approach] = field(default_factory=dict)
    # crossings that a vehicle has waited for long enough
    _claimed: list[int] = field(default_factory=list)

    def update(
        self,
        state: RoadState,
        leading_obstacles: Leaders,
        walks: list[CrossingPedestrian],
        claimed_crossings: set[int],
        time_s: float,
    ) -> Floats:
        """Return free metres [N] to the places to wait at.

        The distance is inf for a vehicle that need not wait. ``walks``: pedestrians on
        crossings; ``claimed_crossings``: crossings where people have waited long
        enough, for which no vehicle gets the right of way.
        """
        self._observe(state, leading_obstacles)
        self._grant(self._first_waiting(), walks, claimed_crossings, time_s)
        # that of a closed loop cannot be told to wait: others let it pass
        driven = self._vehicles.get(self.driven)
        if driven is not None and driven.rear <= driven.passage.end:
            self._let_pass(driven)
        # the oldest right first: others wait for those who wait
        for vehicle_number, orders in self._granted.items():
            me = self._vehicles[vehicle_number]
            me.wait_gap_m = self._wait_inside(me, orders, walks)
        stop = np.full(len(state), np.inf)
        for row_index, (vehicle_number, me) in enumerate(self._vehicles.items()):
            if vehicle_number in self._granted:
                stop[row_index] = me.wait_gap_m
            elif me.front < me.passage.line + _OVERSHOT_M:
                stop[row_index] = max(me.passage.line - me.front, 0.0)
        return stop

    def free_to_walk(self, walk: CrossingPedestrian) -> bool:
        """Return True if a pedestrian can cross.

        No vehicle with the right of way comes in the needed time.
        """
        if walk.patient and walk.crossing in self._claimed:
            return False  # lets a vehicle go that has waited for long
        vehicles = (self._vehicles[vehicle_number] for vehicle_number in self._granted)
        return not any(
            me.rear < stretch.end and me.meets(stretch, walk)
            for me in vehicles
            for stretch in me.passage.stretches
        )

    def _observe(self, state: RoadState, leading_obstacles: Leaders) -> None:
        """Read the vehicles in order and forget those that left."""
        stops = {
            vehicle_number: self._vehicles[vehicle_number].wait_gap_m
            for vehicle_number in self._granted
        }
        columns = (
            state.numbers,
            state.route,
            state.progress + state.length / 2,
            state.progress - state.length / 2,
            state.speed,
            state.style[:, ACCELERATION],
            np.where(
                leading_obstacles.speed < _SLOW_MPS, leading_obstacles.gap, np.inf
            ),
        )
        self._vehicles = {}
        for vehicle_number, route, *values in zip(
            *(column.tolist() for column in columns), strict=True
        ):  # the values are in the order of the fields
            approach = _Approach(self.passages[route], route, *values)
            approach.wait_gap_m = stops.get(vehicle_number, math.inf)
            self._vehicles[vehicle_number] = approach
        for vehicle_number in [*self._granted]:
            me = self._vehicles.get(vehicle_number)
            if me is None or me.rear > me.passage.end:
                del self._granted[vehicle_number]
        for vehicle_number in self._asked_s.keys() - self._vehicles.keys():
            del self._asked_s[vehicle_number]

    def _first_waiting(self) -> list[int]:
        """Return the first vehicle on each approach that still waits at its line."""
        first_numbers: dict[int, int] = {}
        for vehicle_number, me in self._vehicles.items():
            if vehicle_number in self._granted or not me.behind_line:
                continue
            leader = first_numbers.get(me.passage.entry)
            if leader is None or _middle(me) > _middle(self._vehicles[leader]):
                first_numbers[me.passage.entry] = vehicle_number
        return list(first_numbers.values())

    def _grant(
        self,
        waiting: list[int],
        walks: list[CrossingPedestrian],
        claimed_crossings: set[int],
        time_s: float,
    ) -> None:
        """Give waiting vehicles the right of way in the order of asking."""
        impatient_routes: list[int] = []
        self._claimed = []
        asking_times = self._asking(waiting, time_s)
        for asked_s, vehicle_number in sorted(asking_times):
            me = self._vehicles[vehicle_number]
            # it would get ahead of a vehicle that has waited for long
            if any(route in me.passage.zones for route in impatient_routes):
                continue
            zone_order = self._order(me, walks, claimed_crossings)
            if zone_order is not None:
                self._granted[vehicle_number], followers = zone_order
                for follower_number, zone in followers:
                    self._granted[follower_number].append((vehicle_number, zone))
                continue
            if time_s - asked_s > _PATIENCE_S:
                impatient_routes.append(me.route)
            if time_s - asked_s > _COURTESY_S:
                self._claimed += [stretch.crossing for stretch in me.passage.stretches]

    def _asking(self, waiting: list[int], time_s: float) -> list[tuple[float, int]]:
        """Return times of asking, and numbers, of vehicles close to their line."""
        for vehicle_number in waiting:
            me = self._vehicles[vehicle_number]
            ask_distance_m = _ASK_DISTANCE_M + _ASK_TIME_S * me.speed
            if me.passage.line - me.front < ask_distance_m:
                self._asked_s.setdefault(vehicle_number, time_s)
        return [(self._asked_s[n], n) for n in waiting if n in self._asked_s]

    def _order(
        self,
        me: _Approach,
        walks: list[CrossingPedestrian],
        claimed_crossings: set[int],
    ) -> tuple[Orders, Orders] | None:
        """Return vehicles to let go first, and those that wait for this one.

        None if it cannot go now.
        """
        for stretch in me.passage.stretches:
            if stretch.crossing in claimed_crossings or me.meets_any(stretch, walks):
                return None
        leaders: Orders = []
        followers: Orders = []
        for vehicle_number in self._granted:
            other_approach = self._vehicles[vehicle_number]
            for zone in me.passage.zones.get(other_approach.route, ()):
                if other_approach.has_left(zone):
                    continue
                if (
                    me.earliest_arrival_s(zone.start)
                    > other_approach.latest_clearance_s(zone.other_end) + _AFTER_S
                ):
                    leaders.append((vehicle_number, zone))
                elif self._can_go_before(me, other_approach, zone):
                    followers.append((vehicle_number, zone.mirrored))
                else:
                    return None
        return leaders, followers

    def _let_pass(self, me: _Approach) -> None:
        """Let the driven vehicle go where it cannot stop.

        Vehicles that can stop let it pass.
        """
        # where it would stand if it braked now
        reach_m = me.front + me.speed**2 / (2 * _DRIVEN_BRAKING_MPS2)
        if reach_m > me.passage.line:
            self._granted.setdefault(self.driven, [])
        if self.driven not in self._granted:
            return
        for vehicle_number, orders in self._granted.items():
            if vehicle_number == self.driven:
                continue
            other_approach = self._vehicles[vehicle_number]
            other_reach = other_approach.front + other_approach.speed**2 / (
                2 * _OTHERS_BRAKING_MPS2
            )
            for zone in me.passage.zones.get(other_approach.route, ()):
                zone_order = (self.driven, zone.mirrored)
                stops = other_reach < zone.other_start
                if reach_m > zone.start and stops and zone_order not in orders:
                    orders.append(zone_order)

    def _can_go_before(
        self, me: _Approach, other_approach: _Approach, zone: ConflictZone
    ) -> bool:
        if self.first_in_first_out or other_approach.front > zone.other_start:
            return False
        return me.latest_clearance_s(
            zone.end
        ) + _BEFORE_S < other_approach.earliest_arrival_s(zone.other_start)

    def _wait_inside(
        self, me: _Approach, orders: Orders, walks: list[CrossingPedestrian]
    ) -> float:
        """Return the free metres of a vehicle with the right of way.

        They end at the first stretch that is not free in time.
        """
        stop = math.inf
        for vehicle_number, zone in orders:
            if vehicle_number not in self._granted or me.front > zone.start + _INSIDE_M:
                continue
            other_approach = self._vehicles[vehicle_number]
            latest = other_approach.latest_clearance_s(zone.other_end) + _MIN_AFTER_S
            if (
                not other_approach.has_left(zone)
                and me.earliest_arrival_s(zone.start) < latest
            ):
                stop = min(stop, max(zone.start - me.front, 0.0))
        for stretch in me.passage.stretches:
            if me.front < stretch.start and me.meets_any(stretch, walks):
                room_m = stretch.start - me.front - _STRETCH_GAP_M
                stop = min(stop, max(room_m, 0.0))
        return stop


def _middle(vehicle: _Approach) -> float:
    return (vehicle.front + vehicle.rear) / 2


def _travel_time(
    distance_m: float, speed: float, acceleration_mps2: float, cruise_mps: float
) -> float:
    """Return seconds over a distance with acceleration up to a cruising speed."""
    if distance_m <= 0.0:
        return 0.0
    if speed >= cruise_mps:
        return distance_m / speed
    gaining_m = (cruise_mps * cruise_mps - speed * speed) / (2 * acceleration_mps2)
    if distance_m <= gaining_m:
        top_mps = math.sqrt(speed * speed + 2 * acceleration_mps2 * distance_m)
        return (top_mps - speed) / acceleration_mps2
    return (cruise_mps - speed) / acceleration_mps2 + (
        distance_m - gaining_m
    ) / cruise_mps
