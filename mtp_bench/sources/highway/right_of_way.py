"""Who goes first at a junction: first come, first served, where routes come too close.

A vehicle asks for the right to pass when it comes near its line. It gets it if it will reach every stretch that it
shares with somebody who already has the right after that one has left it (or, where the map says so, well before that
one comes), and if nobody on foot is in the way. Until then it stops at its line. With the right it still waits in front
of a stretch that is not free in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...types import Floats
from . import plans
from .conflicts import Passage, Stripe, Zone
from .following import Leaders
from .state import State

_ASK = 14.0  # m before the line at which a vehicle asks, and more at speed
_AFTER, _BEFORE = 0.6, 0.5  # s between two vehicles at a shared stretch
_KEEP = 0.2  # s, what is left of it before somebody with the right waits after all
_PATIENCE = 6.0  # s, then nobody else may go in front
_COURTESY = 10.0  # s, then people who have just come to a crossing let a vehicle go first
_BESIDE = 1.7  # m from the middle of a vehicle's way to a pedestrian who is out of it
_ON_FOOT = 1.0  # s between a vehicle and a pedestrian
_OVERSHOT = 3.0  # m: who stopped this far behind the line still waits
_SLOW = 1.0  # m/s: who is slower may stay where it is


@dataclass(frozen=True)
class Walk:
    """A pedestrian on, or about to step on, a crossing."""

    crossing: int
    across: float  # m along the crossing's axis
    direction: float  # +1 or -1
    speed: float
    patient: bool = False  # lets a vehicle go first that has waited long


@dataclass
class _Vehicle:
    route: int
    front: float  # m from the start of the route
    rear: float
    speed: float
    acceleration: float
    free: float  # m to somebody slow ahead
    held: float = math.inf  # m to where it has to wait


@dataclass
class RightOfWay:
    """The rights that are given out, by vehicle number."""

    passages: tuple[Passage, ...]
    first_in_first_out: bool
    _granted: dict[int, list[tuple[int, Zone]]] = field(default_factory=dict)  # whom to let go first, and where
    _asked: dict[int, float] = field(default_factory=dict)  # time
    _seen: dict[int, _Vehicle] = field(default_factory=dict)
    _wanted: list[int] = field(default_factory=list)  # crossings that a vehicle has waited for long enough

    def update(self, state: State, ahead: Leaders, walks: list[Walk], claimed: set[int], time: float) -> Floats:
        """Free metres ``[N]`` from everybody's bumper to where it must wait; inf: it need not.

        ``state``: where everybody is; ``ahead``: whom they follow; ``walks``: who is on foot where; ``time``: s.
        ``claimed``: crossings where somebody on foot has waited long enough; nobody gets the right to pass them.
        """
        self._look(state, ahead)
        self._forget()
        stop = np.full(len(state), np.inf)
        waiting = self._waiting(state)
        self._give(waiting, walks, claimed, time)
        place = {vehicle.number: i for i, vehicle in enumerate(state.vehicles)}
        for number, yields in self._granted.items():  # oldest right first: others wait for those who wait
            me = self._seen[number]
            stop[place[number]] = me.held = self._wait_inside(me, yields, walks)
        for number, i in place.items():
            me = self._seen[number]
            if number not in self._granted and me.front < self.passages[me.route].line + _OVERSHOT:
                stop[i] = max(self.passages[me.route].line - me.front, 0.0)
        return stop

    def free_to_walk(self, walk: Walk) -> bool:
        """Whether somebody may step on a crossing: nobody with the right to pass comes in that time."""
        if walk.patient and walk.crossing in self._wanted:
            return False
        for number in self._granted:
            me = self._seen[number]
            for stripe in self.passages[me.route].stripes:
                if stripe.crossing == walk.crossing and me.rear < stripe.end and self._meets(me, stripe, walk):
                    return False
        return True

    def _look(self, state: State, ahead: Leaders) -> None:
        front, rear = state.way + state.length / 2, state.way - state.length / 2
        free = np.where(ahead.speed < _SLOW, ahead.gap, np.inf)
        rows = zip(
            state.route.tolist(), front.tolist(), rear.tolist(), state.speed.tolist(), state.temper[:, 4].tolist(),
            free.tolist(), strict=True,
        )  # fmt: skip
        before = self._seen
        self._seen = {vehicle.number: _Vehicle(*row) for vehicle, row in zip(state.vehicles, rows, strict=True)}
        for number in self._granted:
            if number in self._seen:  # where it had to wait a step ago
                self._seen[number].held = before[number].held

    def _forget(self) -> None:
        inside = {n for n, me in self._seen.items() if me.rear <= self.passages[me.route].end}
        self._granted = {n: yields for n, yields in self._granted.items() if n in inside}
        self._asked = {n: time for n, time in self._asked.items() if n in self._seen}

    def _waiting(self, state: State) -> list[int]:
        """The first on every approach who has no right yet."""
        first: dict[int, tuple[float, int]] = {}
        for vehicle, way in zip(state.vehicles, state.way.tolist(), strict=True):
            passage = self.passages[self._seen[vehicle.number].route]
            if vehicle.number in self._granted or self._seen[vehicle.number].front > passage.line + _OVERSHOT:
                continue
            if passage.entry not in first or way > first[passage.entry][0]:
                first[passage.entry] = (way, vehicle.number)
        return [number for _, number in first.values()]

    def _give(self, waiting: list[int], walks: list[Walk], claimed: set[int], time: float) -> None:
        for number in waiting:
            me = self._seen[number]
            if self.passages[me.route].line - me.front < _ASK + plans.ASK_TIME * me.speed:
                self._asked.setdefault(number, time)
        impatient: list[int] = []  # routes
        self._wanted = []
        for since, number in sorted((self._asked[n], n) for n in waiting if n in self._asked):
            me = self._seen[number]
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
                self._wanted += [stripe.crossing for stripe in self.passages[me.route].stripes]

    def _order(
        self, me: _Vehicle, walks: list[Walk], claimed: set[int]
    ) -> tuple[list[tuple[int, Zone]], list[tuple[int, Zone]]] | None:
        """Whom to let go first and who has to let this one go first; None: it cannot go now."""
        passage = self.passages[me.route]
        for stripe in passage.stripes:
            if stripe.crossing in claimed or any(self._meets(me, stripe, w) for w in walks):
                return None
        yields: list[tuple[int, Zone]] = []
        before: list[tuple[int, Zone]] = []
        for number in self._granted:
            other = self._seen[number]
            for zone in passage.zones.get(other.route, ()):
                if _left(other, zone):
                    continue
                if self._soonest(me, zone.start) > self._latest(other, zone) + _AFTER:
                    yields.append((number, zone))
                elif self._may_go_before(me, other, zone):
                    before.append((number, zone.mirrored))
                else:
                    return None
        return yields, before

    def _may_go_before(self, me: _Vehicle, other: _Vehicle, zone: Zone) -> bool:
        if self.first_in_first_out or other.front > zone.other_start:
            return False
        return self._latest(me, zone.mirrored) + _BEFORE < self._soonest(other, zone.other_start)

    def _wait_inside(self, me: _Vehicle, yields: list[tuple[int, Zone]], walks: list[Walk]) -> float:
        """Free metres for somebody with the right to pass."""
        stop = math.inf
        for number, zone in yields:
            if number not in self._granted or me.front > zone.start + 0.5:
                continue
            other = self._seen[number]
            if not _left(other, zone) and self._soonest(me, zone.start) < self._latest(other, zone) + _KEEP:
                stop = min(stop, max(zone.start - me.front, 0.0))
        for stripe in self.passages[me.route].stripes:
            if me.front < stripe.start and any(self._meets(me, stripe, w) for w in walks):
                stop = min(stop, max(stripe.start - me.front - 0.3, 0.0))
        return stop

    def _meets(self, me: _Vehicle, stripe: Stripe, walk: Walk) -> bool:
        """Whether the vehicle and the pedestrian would be in each other's way on a crossing."""
        if walk.crossing != stripe.crossing or me.rear > stripe.end:
            return False
        to_middle = (stripe.across - walk.across) * walk.direction
        if to_middle < -_BESIDE:
            return False
        enters = max(to_middle - _BESIDE, 0.0) / walk.speed
        leaves = (to_middle + _BESIDE) / walk.speed
        gone = Zone(0.0, 0.0, stripe.start, stripe.end, False)
        return self._soonest(me, stripe.start) < leaves + _ON_FOOT / 2 and enters < self._latest(me, gone) + _ON_FOOT

    def _soonest(self, vehicle: _Vehicle, place: float) -> float:
        return _time(place - vehicle.front, vehicle.speed, 2.2, 1.05 * self.passages[vehicle.route].cruise)

    def _latest(self, other: _Vehicle, zone: Zone) -> float:
        if min(other.free, other.held) < zone.other_end - other.rear:
            return math.inf
        cruise = 0.85 * self.passages[other.route].cruise
        return _time(zone.other_end - other.rear, other.speed, 0.7 * other.acceleration, cruise)


def _left(other: _Vehicle, zone: Zone) -> bool:
    """Whether the other one has left the shared stretch, or is ahead on the common way."""
    return (other.front + other.rear) / 2 > zone.other_end if zone.merging else other.rear > zone.other_end


def _time(distance: float, speed: float, acceleration: float, cruise: float) -> float:
    """Seconds over a distance, accelerating up to a cruising speed."""
    if distance <= 0.0:
        return 0.0
    if speed >= cruise:
        return distance / speed
    gaining = (cruise * cruise - speed * speed) / (2 * acceleration)
    if distance <= gaining:
        return (math.sqrt(speed * speed + 2 * acceleration * distance) - speed) / acceleration
    return (cruise - speed) / acceleration + (distance - gaining) / cruise
