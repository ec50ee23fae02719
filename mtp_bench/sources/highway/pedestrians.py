"""People on foot who walk along the sidewalks and cross an arm of the junction, alone or in groups.

At the kerb they wait until nobody with the right to pass comes in the time that
they need; who has waited long makes vehicles wait.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...types import Bools, Floats, Ints
from . import plans
from .footways import Footway, cut, draw_side, kept_off_road, slowed_at_kerb
from .moods import Moods
from .networks import Pavement, RoadMap
from .right_of_way import Walk
from .social_force import eased, kept_apart, kept_out, shortened, social_force

ARRIVING, WAITING, CROSSING, LEAVING = range(4)
_ROOM = 0.85  # m around somebody who comes
_PATIENCE = (3.0, 7.0)  # s at the kerb
_HARDEST = 3.8  # m/s2, how people change their velocity
_NEAR, _QUEUED = 0.7, 2.0  # m to the place to wait at: there, or standing behind others
_CORNER = 2.0  # m, who is this near to a point on the way turns to the next one
_LOOKS = 3.0  # m before the place to wait at, from where people see whether they may cross
_STROLL = 0.55  # share of the groups who do not cross
_GONE = 1.4  # m to the end of the way
_CROSSED, _COME = 0.25, 0.8  # of the first people: share who have crossed, largest share of the way of the others done


@dataclass(eq=False)
class Person:
    """Somebody on foot; places are (along the crossing, across it) in metres from its origin."""

    number: int
    group: int
    crossing: int
    direction: float
    size: tuple[float, float, float]  # l w h
    pace: float
    patience: float
    slot: Floats  # where to wait
    beyond: Floats  # where to step off the road
    departure: list[Floats]  # points of the way from there
    place: Floats
    ahead: list[Floats]  # points of the way before the crossing, or after it, that are still to come
    stage: int
    trail: list[Floats]  # points of the way that are behind; empty for who does not turn back
    velocity: Floats = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    waited: float = 0.0


class Crowd:
    """Everybody on foot: keeps their number on the map at what is aimed at."""

    def __init__(self, town: RoadMap, aim: int, rng: np.random.Generator, moods: Moods) -> None:
        self._crossings, self._pavement = town.crossings, town.pavement
        self._aim, self._rng, self._moods = aim, rng, moods
        self.people: list[Person] = []
        self._made = self._groups = 0
        self._origin = np.array([c.origin for c in town.crossings], dtype=np.float64).reshape(-1, 2)
        self._axes = np.array(
            [(c.direction, (-c.direction[1], c.direction[0])) for c in town.crossings], dtype=np.float64
        ).reshape(-1, 2, 2)  # rows: along, across
        for _ in range(20 * aim):
            if len(self.people) < aim:
                stage = LEAVING if rng.uniform() < _CROSSED else ARRIVING
                self._arrive(stage, float(rng.uniform(1.0 - _COME, 1.0)))
                moods.stand(self._groups - 1)

    def xy(self) -> tuple[Floats, Floats]:
        """Places and velocities ``[M, 2]``, ``[M, 2]`` in the frame of the road."""
        crossing = self._crossing()
        own = np.array([(p.place, p.velocity) for p in self.people], dtype=np.float64).reshape(-1, 2, 2)
        turned = own @ self._axes[crossing]
        return self._origin[crossing] + turned[:, 0], turned[:, 1]

    def _crossing(self) -> Ints:
        return np.array([p.crossing for p in self.people], dtype=np.int64)

    def boxes(self) -> Floats:
        """Boxes ``[M, 7]`` in the frame of the road (y down)."""
        rows = [(p.size[2] / 2, p.heading, *p.size) for p in self.people]
        return np.column_stack([self.xy()[0], np.array(rows, dtype=np.float64).reshape(-1, 5)])

    def walks(self) -> list[Walk]:
        """Those who are on a crossing."""
        return [self._walk(p) for p in self.people if p.stage == CROSSING]

    def claimed(self) -> set[int]:
        """Crossings where somebody has lost patience."""
        return {p.crossing for p in self.people if p.stage == WAITING and p.waited > p.patience}

    def step(self, dt: float, vehicles: Floats, free: Callable[[Walk], bool]) -> None:
        """Moves everybody by ``dt`` seconds around vehicles (boxes ``[N, 7]``) and lets new people come."""
        if self._pavement is None:
            return
        self._moods.step(np.array([p.group for p in self.people], dtype=np.int64))
        self._turn_back(self._moods.turning)
        self._advance(dt, free)
        self._move(dt, vehicles, self._pavement)
        self.people = [p for p in self.people if p.stage != LEAVING or len(p.ahead) > 1 or _left(p) > _GONE]
        if len(self.people) < self._aim and self._rng.uniform() < dt / 1.5:
            self._arrive(ARRIVING, 1.0)

    def _walk(self, person: Person) -> Walk:
        patient = person.stage != CROSSING and person.waited <= person.patience
        return Walk(person.crossing, float(person.place[0]), person.direction, max(0.85 * person.pace, 0.5), patient)

    def _arrive(self, stage: int, share: float) -> None:
        """A new group on its way to a crossing or away from it; ``share``: how much of that way is left."""
        if self._pavement is None:
            return
        rng = self._rng
        crossing = self._draw_crossing(rng)
        size = int(min(rng.choice(4, p=(0.5, 0.3, 0.15, 0.05)) + 1, self._aim - len(self.people)))
        way = Footway(
            self._crossings[crossing], self._pavement, direction=1.0 if rng.uniform() < 0.5 else -1.0,
            middle=float(rng.uniform(-0.8, 0.8)) if size == 1 else float(rng.uniform(-0.95, 0.05)),
            coming=draw_side(True, rng), going=draw_side(False, rng),
        )  # fmt: skip
        pace, patience = float(rng.uniform(1.05, 1.55)), float(rng.uniform(*_PATIENCE))
        strolls = bool(rng.uniform() < _STROLL)
        others = self.xy()[0]
        for k in range(size):
            points = way.stroll(k) if strolls else way.arrival(k) if stage == ARRIVING else way.departure(k)
            place, *ahead = cut(points, share)
            there = self._origin[crossing] + place @ self._axes[crossing]
            if len(others) and np.hypot(*(others - there).T).min() < _ROOM:
                continue
            others = np.concatenate([others, there[None]])
            person = self._person(crossing, way, k, LEAVING if strolls else stage, place, ahead, pace, patience)
            if strolls or stage == ARRIVING:
                person.trail = points[: -len(ahead)]
            self.people.append(person)
        self._groups += 1

    def _draw_crossing(self, rng: np.random.Generator) -> int:
        """People cross the quieter arms more often."""
        quiet = 1.0 / np.array(plans.ARMS)
        return int(rng.choice(len(self._crossings), p=quiet / quiet.sum()))

    def _person(self, crossing: int, way: Footway, k: int, stage: int, place: Floats, ahead: list[Floats],
                pace: float, patience: float) -> Person:  # fmt: skip
        rng = self._rng
        sizes = rng.uniform((0.35, 0.45, 1.5), (0.5, 0.6, 1.9)).tolist()
        own = min(max(pace + float(rng.normal(0.0, 0.05)), 1.0), 1.6)
        course = (ahead[0] - place) / max(float(np.hypot(*(ahead[0] - place))), 1e-6)
        self._made += 1
        return Person(
            number=self._made, group=self._groups, crossing=crossing, direction=way.direction,
            size=(round(sizes[0], 2), round(sizes[1], 2), round(sizes[2], 2)), pace=own, patience=patience,
            slot=way.slot(k), beyond=way.beyond(k), departure=way.departure(k)[1:], place=np.round(place, 6),
            ahead=ahead, stage=stage, trail=[], velocity=np.round(own * course, 6) + 0.0,
            heading=_direction(course @ self._axes[crossing]),
        )  # fmt: skip

    def _advance(self, dt: float, free: Callable[[Walk], bool]) -> None:
        """Moves everybody on to the next stage; a group steps on the road together."""
        for p in self.people:
            if len(p.ahead) > 1 and _left(p) < _CORNER:
                p.trail += p.ahead[:1] if p.trail else []
                p.ahead = p.ahead[1:]
            if p.stage == ARRIVING and len(p.ahead) == 1 and _left(p) < (_QUEUED if _stands(p) else _NEAR):
                p.stage = WAITING
            elif p.stage == WAITING:
                p.waited += dt
            elif p.stage == CROSSING and (p.beyond[0] - p.place[0]) * p.direction < 0.2:
                p.stage, p.ahead = LEAVING, p.departure
        for group in sorted({p.group for p in self.people if self._at_kerb(p)}):
            members = [p for p in self.people if p.group == group]
            ready = group in self._moods.ready
            if ready and all(self._at_kerb(p) for p in members) and all(free(self._walk(p)) for p in members):
                for p in members:
                    p.stage, p.trail = CROSSING, []

    def _at_kerb(self, person: Person) -> bool:
        """Whether somebody waits, or comes near enough to walk on without a stop."""
        comes = person.stage == ARRIVING and len(person.ahead) == 1
        return person.stage == WAITING or (comes and _left(person) < _LOOKS)

    def _turn_back(self, groups: set[int]) -> None:
        for p in self.people:
            if p.group in groups and p.trail and p.stage in (ARRIVING, LEAVING):
                p.ahead, p.trail, p.stage = p.trail[::-1], [], LEAVING

    def _move(self, dt: float, vehicles: Floats, pavement: Pavement) -> None:
        if not self.people:
            return
        place, velocity = self.xy()
        crossing = self._crossing()
        axes, origin = self._axes[crossing], self._origin[crossing]
        goal = origin + np.einsum("ni,nij->nj", np.array([_target(p) for p in self.people]), axes)
        pace = np.array([p.pace for p in self.people])
        group = np.array([p.group for p in self.people])
        beside = np.array([p.stage != CROSSING for p in self.people])
        way = goal - place
        number = np.array([p.number for p in self.people])
        way = self._moods.heading_for(way, number, ~beside)
        pace = self._moods.pace(pace, number, group, ~beside)
        new = shortened(velocity + dt * social_force(place, velocity, way, pace, group), 1.25 * pace)
        new = slowed_at_kerb(place, eased(place, new, vehicles, dt), pavement, beside)
        new = velocity + shortened(new - velocity, _HARDEST * dt)
        moved = kept_off_road(kept_apart(place + dt * new), pavement, beside)
        moved = kept_out(place, moved, vehicles)
        new = (moved - place) / dt
        own = np.round(np.einsum("nij,nkj->nki", axes, np.stack([moved - origin, new], axis=1)), 6) + 0.0
        waiting = np.array([p.stage == WAITING for p in self.people])
        heading = _turned(np.array([p.heading for p in self.people]), new, goal - moved, waiting)
        for p, (there, speed), course in zip(self.people, own, heading.tolist(), strict=True):
            p.place, p.velocity, p.heading = there, speed, course


def _target(person: Person) -> Floats:
    if person.stage == CROSSING:
        return person.beyond
    return person.slot if person.stage == WAITING else person.ahead[0]


def _left(person: Person) -> float:
    """Metres to the next point of the way."""
    return float(np.hypot(*(person.ahead[0] - person.place)))


def _stands(person: Person) -> bool:
    return bool(np.hypot(*person.velocity) < 0.3)


def _direction(vector: Floats) -> float:
    return round(float(np.arctan2(vector[1], vector[0])), 6)


def _turned(heading: Floats, velocity: Floats, to_goal: Floats, waiting: Bools) -> Floats:
    """The headings ``[M]`` after a step: people turn where they walk, and look at the road while they wait."""
    walks = np.hypot(velocity[:, 0], velocity[:, 1]) > 0.3
    course = np.where(walks[:, None], velocity, to_goal)
    turn = (np.arctan2(course[:, 1], course[:, 0]) - heading + np.pi) % (2 * np.pi) - np.pi
    turned = (heading + np.where(walks, 0.35, 0.1) * turn + np.pi) % (2 * np.pi) - np.pi
    return np.where(walks | ~waiting, np.round(turned, 6) + 0.0, heading)
