"""Right of way at a junction: first come, first served, where routes conflict.

Near its line a vehicle asks for the right of way. It gets it if it will reach every shared stretch after the vehicles
that have it have left (or, if the map allows it, well before they come), and if no pedestrian is in the way. Until then
it stops at its line; with the right of way it still waits before a stretch that is not free in time.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ...core import Floats
from .conflicts import ConflictZone, CrossingStretch, Passage
from .driving import Leaders, RoadState
from .world import ASK_TIME

Orders = list[
    tuple[int, ConflictZone]
]  # numbers of vehicles, each with a zone shared with it
_ASK = 14.0  # m before the line at which a vehicle asks, and more at speed
_AFTER, _BEFORE = 0.6, 0.5  # s between two vehicles at a shared stretch
_KEEP = 0.2  # s of it that must remain, otherwise a vehicle with the right of way waits
_PATIENCE = 6.0  # s after which no conflicting vehicle gets the right of way first
_COURTESY = (
    10.0  # s after which people who have just come to a crossing let a vehicle go first
)
_BESIDE = 1.7  # m from the middle of a vehicle's path to a pedestrian outside of it
_ON_FOOT = 1.0  # s between a vehicle and a pedestrian
_OVERSHOT = 3.0  # m; a vehicle that stopped this far behind the line still waits
_SLOW = 1.0  # m/s; a slower vehicle may stay in its place
_FIRM = (
    3.0,
    5.0,
)  # m/s2, braking before a line: of the driven vehicle, and of others who see it come


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
    route: int
    front: float  # m from the start of the route
    rear: float
    speed: float
    acceleration: float
    free: float  # m to a slow leader
    stop: float = math.inf  # m to the place where it has to wait


@dataclass
class RightOfWay:
    """Granted rights of way, by vehicle number."""

    passages: tuple[Passage, ...]
    first_in_first_out: bool
    driven: int = -1  # number of a vehicle that cannot be told to wait; others let it pass where it cannot stop
    _granted: dict[int, Orders] = field(
        default_factory=dict
    )  # vehicles to let go first
    _asked: dict[int, float] = field(default_factory=dict)  # time
    _vehicles: dict[int, _Approach] = field(default_factory=dict)
    _claimed: list[int] = field(
        default_factory=list
    )  # crossings that a vehicle has waited for long enough

    def update(
        self,
        state: RoadState,
        ahead: Leaders,
        walks: list[CrossingPedestrian],
        claimed: set[int],
        time: float,
    ) -> Floats:
        """Free metres ``[N]`` from each bumper to the place to wait at; inf if it need not wait.

        ``walks``: pedestrians on crossings; ``claimed``: crossings where people have waited long enough, for which no
        vehicle gets the right of way; ``time``: s.
        """
        self._observe(state, ahead)
        stop = np.full(len(state), np.inf)
        waiting = self._first_waiting(state)
        self._grant(waiting, walks, claimed, time)
        self._let_pass(self._vehicles.get(self.driven))
        index = {vehicle.number: i for i, vehicle in enumerate(state.vehicles)}
        for (
            number,
            yields,
        ) in (
            self._granted.items()
        ):  # the oldest right first: others wait for those who wait
            me = self._vehicles[number]
            stop[index[number]] = me.stop = self._wait_inside(me, yields, walks)
        for number, i in index.items():
            me = self._vehicles[number]
            if (
                number not in self._granted
                and me.front < self.passages[me.route].line + _OVERSHOT
            ):
                stop[i] = max(self.passages[me.route].line - me.front, 0.0)
        return stop

    def free_to_walk(self, walk: CrossingPedestrian) -> bool:
        """True if no vehicle with the right of way comes in the time that a pedestrian needs to cross."""
        if walk.patient and walk.crossing in self._claimed:
            return False
        for number in self._granted:
            me = self._vehicles[number]
            for stretch in self.passages[me.route].stretches:
                if (
                    stretch.crossing == walk.crossing
                    and me.rear < stretch.end
                    and self._meets(me, stretch, walk)
                ):
                    return False
        return True

    def _observe(self, state: RoadState, ahead: Leaders) -> None:
        front, rear = (
            state.progress + state.length / 2,
            state.progress - state.length / 2,
        )
        free = np.where(ahead.speed < _SLOW, ahead.gap, np.inf)
        columns = (
            state.numbers,
            state.route,
            front,
            rear,
            state.speed,
            state.style[:, 4],
            free,
        )
        before = self._vehicles
        rows = zip(*(column.tolist() for column in columns), strict=True)
        self._vehicles = {number: _Approach(*row) for number, *row in rows}
        for number in self._granted:
            if number in self._vehicles:
                self._vehicles[number].stop = before[number].stop
        inside = {
            n
            for n, me in self._vehicles.items()
            if me.rear <= self.passages[me.route].end
        }
        self._granted = {
            n: yields for n, yields in self._granted.items() if n in inside
        }
        self._asked = {
            n: time for n, time in self._asked.items() if n in self._vehicles
        }

    def _first_waiting(self, state: RoadState) -> list[int]:
        """The first vehicle of every approach without the right of way."""
        first: dict[int, tuple[float, int]] = {}
        for number, progress in zip(
            state.numbers.tolist(), state.progress.tolist(), strict=True
        ):
            passage = self.passages[self._vehicles[number].route]
            if (
                number in self._granted
                or self._vehicles[number].front > passage.line + _OVERSHOT
            ):
                continue
            if passage.entry not in first or progress > first[passage.entry][0]:
                first[passage.entry] = (progress, number)
        return [number for _, number in first.values()]

    def _grant(
        self,
        waiting: list[int],
        walks: list[CrossingPedestrian],
        claimed: set[int],
        time: float,
    ) -> None:
        for number in waiting:
            me = self._vehicles[number]
            if self.passages[me.route].line - me.front < _ASK + ASK_TIME * me.speed:
                self._asked.setdefault(number, time)
        impatient: list[int] = []  # routes
        self._claimed = []
        for since, number in sorted(
            (self._asked[n], n) for n in waiting if n in self._asked
        ):
            me = self._vehicles[number]
            if any(route in self.passages[me.route].zones for route in impatient):
                continue
            order = self._order(me, walks, claimed)
            if order is not None:
                yields, before = order
                self._granted[number] = yields
                for other, zone in before:
                    self._granted[other].append((number, zone))
                continue
            if time - since > _PATIENCE:
                impatient.append(me.route)
            if time - since > _COURTESY:
                self._claimed += [
                    stretch.crossing for stretch in self.passages[me.route].stretches
                ]

    def _order(
        self, me: _Approach, walks: list[CrossingPedestrian], claimed: set[int]
    ) -> tuple[Orders, Orders] | None:
        """Vehicles to let go first, and vehicles that must let this one go first; None if it cannot go now."""
        passage = self.passages[me.route]
        for stretch in passage.stretches:
            if stretch.crossing in claimed or any(
                self._meets(me, stretch, walk) for walk in walks
            ):
                return None
        yields: Orders = []
        before: Orders = []
        for number in self._granted:
            other = self._vehicles[number]
            for zone in passage.zones.get(other.route, ()):
                if _has_left(other, zone):
                    continue
                if (
                    self._soonest(me, zone.start)
                    > self._latest(other, zone.other_end) + _AFTER
                ):
                    yields.append((number, zone))
                elif self._can_go_before(me, other, zone):
                    before.append((number, zone.mirrored))
                else:
                    return None
        return yields, before

    def _let_pass(self, me: _Approach | None) -> None:
        """Give the driven vehicle the right of way where it can no longer stop; vehicles that can stop let it pass."""
        if me is None or me.rear > self.passages[me.route].end:
            return
        reach, passage = (
            me.front + me.speed**2 / (2 * _FIRM[0]),
            self.passages[me.route],
        )
        if reach > passage.line:
            self._granted.setdefault(self.driven, [])
        for number, orders in (
            self._granted.items() if self.driven in self._granted else ()
        ):
            other = self._vehicles[number]
            for zone in (
                passage.zones.get(other.route, ()) if number != self.driven else ()
            ):
                order = (self.driven, zone.mirrored)
                stops = other.front + other.speed**2 / (2 * _FIRM[1]) < zone.other_start
                if reach > zone.start and stops and order not in orders:
                    orders.append(order)

    def _can_go_before(
        self, me: _Approach, other: _Approach, zone: ConflictZone
    ) -> bool:
        if self.first_in_first_out or other.front > zone.other_start:
            return False
        return self._latest(me, zone.end) + _BEFORE < self._soonest(
            other, zone.other_start
        )

    def _wait_inside(
        self, me: _Approach, yields: Orders, walks: list[CrossingPedestrian]
    ) -> float:
        """Free metres of a vehicle with the right of way."""
        stop = math.inf
        for number, zone in yields:
            if number not in self._granted or me.front > zone.start + 0.5:
                continue
            other = self._vehicles[number]
            if (
                not _has_left(other, zone)
                and self._soonest(me, zone.start)
                < self._latest(other, zone.other_end) + _KEEP
            ):
                stop = min(stop, max(zone.start - me.front, 0.0))
        for stretch in self.passages[me.route].stretches:
            if me.front < stretch.start and any(
                self._meets(me, stretch, walk) for walk in walks
            ):
                stop = min(stop, max(stretch.start - me.front - 0.3, 0.0))
        return stop

    def _meets(
        self, me: _Approach, stretch: CrossingStretch, walk: CrossingPedestrian
    ) -> bool:
        """True if the vehicle and the pedestrian would be in each other's way on a crossing."""
        if walk.crossing != stretch.crossing or me.rear > stretch.end:
            return False
        to_middle = (stretch.across - walk.along) * walk.direction
        if to_middle < -_BESIDE:
            return False
        enters = max(to_middle - _BESIDE, 0.0) / walk.speed
        leaves = (to_middle + _BESIDE) / walk.speed
        soonest, latest = (
            self._soonest(me, stretch.start),
            self._latest(me, stretch.end),
        )
        return soonest < leaves + _ON_FOOT / 2 and enters < latest + _ON_FOOT

    def _soonest(self, vehicle: _Approach, place: float) -> float:
        """Earliest time at a place, s from now."""
        return _travel_time(
            place - vehicle.front,
            vehicle.speed,
            2.2,
            1.05 * self.passages[vehicle.route].cruise,
        )

    def _latest(self, other: _Approach, end: float) -> float:
        """Latest time at which the other vehicle passes an ``end``, s from now; inf if it may stop before."""
        if min(other.free, other.stop) < end - other.rear:
            return math.inf
        cruise = 0.85 * self.passages[other.route].cruise
        return _travel_time(
            end - other.rear, other.speed, 0.7 * other.acceleration, cruise
        )


def _has_left(other: _Approach, zone: ConflictZone) -> bool:
    """True if the other vehicle has left the shared stretch, or is ahead on the common way."""
    return (
        (other.front + other.rear) / 2 > zone.other_end
        if zone.merging
        else other.rear > zone.other_end
    )


def _travel_time(
    distance: float, speed: float, acceleration: float, cruise: float
) -> float:
    """Seconds over a distance with acceleration up to a cruising speed."""
    if distance <= 0.0:
        return 0.0
    if speed >= cruise:
        return distance / speed
    gaining = (cruise * cruise - speed * speed) / (2 * acceleration)
    if distance <= gaining:
        return (
            math.sqrt(speed * speed + 2 * acceleration * distance) - speed
        ) / acceleration
    return (cruise - speed) / acceleration + (distance - gaining) / cruise
