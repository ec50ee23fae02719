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
# between two vehicles at a shared stretch
_AFTER_S = 0.6
_BEFORE_S = 0.5
# of it that must remain, otherwise a vehicle with the right of way waits
_MIN_AFTER_S = 0.2
# after which no conflicting vehicle gets the right of way first
_PATIENCE_S = 6.0
# after which people who have just come to a crossing let a vehicle go first
_COURTESY_S = 10.0
# from the middle of a vehicle's path to a pedestrian outside of it
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
    free: float  # m to a slow leader
    stop: float = math.inf  # m to the place where it has to wait

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

    def soonest(self, place: float) -> float:
        """Return the earliest time at a place, s from now."""
        cruise = _FAST_CRUISE * self.passage.cruise
        distance = place - self.front
        return _travel_time(distance, self.speed, _FAST_ACCELERATION_MPS2, cruise)

    def latest(self, end: float) -> float:
        """Return the latest time at an ``end``, s from now.

        Inf if it may stop before.
        """
        distance = end - self.rear
        if min(self.free, self.stop) < distance:
            return math.inf
        acceleration = _SLOW_ACCELERATION * self.acceleration
        cruise = _SLOW_CRUISE * self.passage.cruise
        return _travel_time(distance, self.speed, acceleration, cruise)

    def meets(self, stretch: CrossingStretch, walk: CrossingPedestrian) -> bool:
        """Return True if a pedestrian would be in the way."""
        if walk.crossing != stretch.crossing or self.rear > stretch.end:
            return False
        to_middle = (stretch.across - walk.along) * walk.direction
        if to_middle < -_WALKER_GAP_M:
            return False
        enters = max(to_middle - _WALKER_GAP_M, 0.0) / walk.speed
        leaves = (to_middle + _WALKER_GAP_M) / walk.speed
        comes_before = self.soonest(stretch.start) < leaves + _WALKER_GAP_S / 2
        return comes_before and enters < self.latest(stretch.end) + _WALKER_GAP_S

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
        ahead: Leaders,
        walks: list[CrossingPedestrian],
        claimed: set[int],
        time_s: float,
    ) -> Floats:
        """Return free metres [N] to the places to wait at.

        They are inf for a vehicle that need not wait. ``walks``: pedestrians on
        crossings; ``claimed``: crossings where people have waited long enough, for
        which no vehicle gets the right of way.
        """
        self._observe(state, ahead)
        self._grant(self._first_waiting(), walks, claimed, time_s)
        driven = self._vehicles.get(self.driven)
        if driven is not None and driven.rear <= driven.passage.end:
            self._let_pass(driven)
        # the oldest right first: others wait for those who wait
        for number, orders in self._granted.items():
            me = self._vehicles[number]
            me.stop = self._wait_inside(me, orders, walks)
        stop = np.full(len(state), np.inf)
        for i, (number, me) in enumerate(self._vehicles.items()):
            if number in self._granted:
                stop[i] = me.stop
            elif me.front < me.passage.line + _OVERSHOT_M:
                stop[i] = max(me.passage.line - me.front, 0.0)
        return stop

    def free_to_walk(self, walk: CrossingPedestrian) -> bool:
        """Return True if a pedestrian can cross.

        No vehicle with the right of way comes in the needed time.
        """
        if walk.patient and walk.crossing in self._claimed:
            return False
        vehicles = (self._vehicles[number] for number in self._granted)
        return not any(
            me.rear < stretch.end and me.meets(stretch, walk)
            for me in vehicles
            for stretch in me.passage.stretches
        )

    def _observe(self, state: RoadState, ahead: Leaders) -> None:
        """Read the vehicles in order and forget those that left."""
        stops = {number: self._vehicles[number].stop for number in self._granted}
        columns = (
            state.numbers,
            state.route,
            state.progress + state.length / 2,
            state.progress - state.length / 2,
            state.speed,
            state.style[:, ACCELERATION],
            np.where(ahead.speed < _SLOW_MPS, ahead.gap, np.inf),
        )
        self._vehicles = {}
        for number, route, *values in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            approach = _Approach(self.passages[route], route, *values)
            approach.stop = stops.get(number, math.inf)
            self._vehicles[number] = approach
        for number in [*self._granted]:
            me = self._vehicles.get(number)
            if me is None or me.rear > me.passage.end:
                del self._granted[number]
        for number in self._asked_s.keys() - self._vehicles.keys():
            del self._asked_s[number]

    def _first_waiting(self) -> list[int]:
        """Return the first vehicle of every approach without the right of way."""
        first: dict[int, int] = {}
        for number, me in self._vehicles.items():
            if number in self._granted or not me.behind_line:
                continue
            leader = first.get(me.passage.entry)
            if leader is None or _middle(me) > _middle(self._vehicles[leader]):
                first[me.passage.entry] = number
        return list(first.values())

    def _grant(
        self,
        waiting: list[int],
        walks: list[CrossingPedestrian],
        claimed: set[int],
        time_s: float,
    ) -> None:
        """Give waiting vehicles the right of way in order."""
        impatient_routes: list[int] = []
        self._claimed = []
        asking = self._asking(waiting, time_s)
        for asked_s, number in sorted(asking):
            me = self._vehicles[number]
            if any(route in me.passage.zones for route in impatient_routes):
                continue
            order = self._order(me, walks, claimed)
            if order is not None:
                self._granted[number], followers = order
                for other, zone in followers:
                    self._granted[other].append((number, zone))
                continue
            if time_s - asked_s > _PATIENCE_S:
                impatient_routes.append(me.route)
            if time_s - asked_s > _COURTESY_S:
                self._claimed += [stretch.crossing for stretch in me.passage.stretches]

    def _asking(self, waiting: list[int], time_s: float) -> list[tuple[float, int]]:
        """Return times of asking, and numbers, of vehicles close to their line."""
        for number in waiting:
            me = self._vehicles[number]
            ask_distance_m = _ASK_DISTANCE_M + _ASK_TIME_S * me.speed
            if me.passage.line - me.front < ask_distance_m:
                self._asked_s.setdefault(number, time_s)
        return [(self._asked_s[n], n) for n in waiting if n in self._asked_s]

    def _order(
        self, me: _Approach, walks: list[CrossingPedestrian], claimed: set[int]
    ) -> tuple[Orders, Orders] | None:
        """Return vehicles to let go first, and those that wait.

        None if it cannot go now.
        """
        for stretch in me.passage.stretches:
            if stretch.crossing in claimed or me.meets_any(stretch, walks):
                return None
        leaders: Orders = []
        followers: Orders = []
        for number in self._granted:
            other = self._vehicles[number]
            for zone in me.passage.zones.get(other.route, ()):
                if other.has_left(zone):
                    continue
                if me.soonest(zone.start) > other.latest(zone.other_end) + _AFTER_S:
                    leaders.append((number, zone))
                elif self._can_go_before(me, other, zone):
                    followers.append((number, zone.mirrored))
                else:
                    return None
        return leaders, followers

    def _let_pass(self, me: _Approach) -> None:
        """Let the driven vehicle go where it cannot stop.

        Vehicles that can stop let it pass.
        """
        reach = me.front + me.speed**2 / (2 * _DRIVEN_BRAKING_MPS2)
        if reach > me.passage.line:
            self._granted.setdefault(self.driven, [])
        if self.driven not in self._granted:
            return
        for number, orders in self._granted.items():
            if number == self.driven:
                continue
            other = self._vehicles[number]
            other_reach = other.front + other.speed**2 / (2 * _OTHERS_BRAKING_MPS2)
            for zone in me.passage.zones.get(other.route, ()):
                order = (self.driven, zone.mirrored)
                stops = other_reach < zone.other_start
                if reach > zone.start and stops and order not in orders:
                    orders.append(order)

    def _can_go_before(
        self, me: _Approach, other: _Approach, zone: ConflictZone
    ) -> bool:
        if self.first_in_first_out or other.front > zone.other_start:
            return False
        return me.latest(zone.end) + _BEFORE_S < other.soonest(zone.other_start)

    def _wait_inside(
        self, me: _Approach, orders: Orders, walks: list[CrossingPedestrian]
    ) -> float:
        """Return the free metres of a vehicle with the right of way."""
        stop = math.inf
        for number, zone in orders:
            if number not in self._granted or me.front > zone.start + _INSIDE_M:
                continue
            other = self._vehicles[number]
            latest = other.latest(zone.other_end) + _MIN_AFTER_S
            if not other.has_left(zone) and me.soonest(zone.start) < latest:
                stop = min(stop, max(zone.start - me.front, 0.0))
        for stretch in me.passage.stretches:
            if me.front < stretch.start and me.meets_any(stretch, walks):
                room = stretch.start - me.front - _STRETCH_GAP_M
                stop = min(stop, max(room, 0.0))
        return stop


def _middle(vehicle: _Approach) -> float:
    return (vehicle.front + vehicle.rear) / 2


def _travel_time(
    distance: float, speed: float, acceleration: float, cruise: float
) -> float:
    """Return seconds over a distance with acceleration up to a cruising speed."""
    if distance <= 0.0:
        return 0.0
    if speed >= cruise:
        return distance / speed
    gaining = (cruise * cruise - speed * speed) / (2 * acceleration)
    if distance <= gaining:
        top = math.sqrt(speed * speed + 2 * acceleration * distance)
        return (top - speed) / acceleration
    return (cruise - speed) / acceleration + (distance - gaining) / cruise
