"""People on foot who cross an arm of the junction, alone or in groups.

At the kerb they wait until nobody with the right to pass comes in the time that
they need; who has waited long makes vehicles wait.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...types import Floats
from .networks import Crossing
from .right_of_way import Walk
from .social_force import kept_apart, kept_out, social_force

ARRIVING, WAITING, CROSSING, LEAVING = range(4)
_ROOM = 0.85  # m around somebody who comes
_PATIENCE = (3.0, 7.0)  # s at the kerb


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
    goal: Floats
    place: Floats
    velocity: Floats = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    stage: int = ARRIVING
    waited: float = 0.0


@dataclass(frozen=True, eq=False)
class _Plan:
    """What a group has in common."""

    crossing: int
    direction: float
    span: float  # m of road
    pace: float
    patience: float
    middle: float  # m across the crossing
    way: Floats  # from the kerb back to where they come from
    off: Floats  # from the other kerb to where they go

    def slot(self, k: int) -> Floats:
        """Where the k-th of them waits: two by two."""
        kerb = 0.0 if self.direction > 0 else self.span
        return np.array([kerb - self.direction * (0.9 + 0.95 * (k // 2)), self.middle + 0.9 * (k % 2)])

    def beyond(self, slot: Floats) -> Floats:
        """Where somebody with this slot leaves the road."""
        return np.array([(self.span if self.direction > 0 else 0.0) + self.direction * 0.6, slot[1]])


class Crowd:
    """Everybody on foot: keeps their number at what is aimed at."""

    def __init__(self, crossings: tuple[Crossing, ...], aim: int, rng: np.random.Generator) -> None:
        self._crossings, self._aim, self._rng = crossings, aim, rng
        self.people: list[Person] = []
        self._made = self._groups = 0
        self._axes = [
            np.array([c.direction, (-c.direction[1], c.direction[0])], dtype=np.float64) for c in crossings
        ]  # rows: along, across
        while crossings and len(self.people) < aim:
            self._arrive(float(rng.uniform(0.0, 1.0)))

    def xy(self) -> tuple[Floats, Floats]:
        """Places and velocities ``[M, 2]``, ``[M, 2]`` in the frame of the road."""
        place = [np.array(self._crossings[p.crossing].origin) + p.place @ self._axes[p.crossing] for p in self.people]
        velocity = [p.velocity @ self._axes[p.crossing] for p in self.people]
        return np.array(place).reshape(-1, 2), np.array(velocity).reshape(-1, 2)

    def boxes(self) -> Floats:
        """Boxes ``[M, 7]`` in the frame of the road (y down)."""
        place, _ = self.xy()
        rows = [
            (x, y, p.size[2] / 2, p.heading, *p.size) for p, (x, y) in zip(self.people, place.tolist(), strict=True)
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 7)

    def walks(self) -> list[Walk]:
        """Those who are on a crossing."""
        return [self._walk(p) for p in self.people if p.stage == CROSSING]

    def claimed(self) -> set[int]:
        """Crossings where somebody has lost patience."""
        return {p.crossing for p in self.people if p.stage == WAITING and p.waited > p.patience}

    def step(self, dt: float, vehicles: Floats, free: Callable[[Walk], bool]) -> None:
        """Moves everybody by ``dt`` seconds around vehicles (boxes ``[N, 7]``) and lets new people come."""
        if not self._crossings:
            return
        self._advance(dt, free)
        self._move(dt, vehicles)
        self.people = [p for p in self.people if not (p.stage == LEAVING and np.abs(p.goal - p.place).max() < 0.8)]
        if len(self.people) < self._aim and self._rng.uniform() < dt / 1.5:
            self._arrive(1.0)

    def _walk(self, person: Person) -> Walk:
        return Walk(person.crossing, float(person.place[0]), person.direction, max(0.85 * person.pace, 0.5))

    def _arrive(self, distance: float) -> None:
        """A new group; ``distance``: share of the way to the kerb that is left."""
        rng = self._rng
        crossing = int(rng.integers(len(self._crossings)))
        direction = 1.0 if rng.uniform() < 0.5 else -1.0
        size = int(min(rng.choice(4, p=(0.5, 0.3, 0.15, 0.05)) + 1, self._aim - len(self.people)))
        plan = _Plan(
            crossing, direction, self._crossings[crossing].span,
            pace=float(rng.uniform(1.05, 1.55)), patience=float(rng.uniform(*_PATIENCE)),
            middle=float(rng.uniform(-0.5, 0.5)) - 0.45 * (size > 1),
            way=np.array([-direction * rng.uniform(5.0, 9.0), rng.uniform(-3.0, 3.0)]),
            off=np.array([direction * rng.uniform(5.0, 9.0), rng.uniform(-3.0, 3.0)]),
        )  # fmt: skip
        others = self.xy()[0]
        for k in range(size):
            slot = plan.slot(k)
            place = slot + plan.way * distance
            there = np.array(self._crossings[crossing].origin) + place @ self._axes[crossing]
            if len(others) and np.hypot(*(others - there).T).min() < _ROOM:
                continue
            others = np.concatenate([others, there[None]])
            self.people.append(self._person(plan, slot, place))
        self._groups += 1

    def _person(self, plan: _Plan, slot: Floats, place: Floats) -> Person:
        rng = self._rng
        sizes = rng.uniform((0.35, 0.45, 1.5), (0.5, 0.6, 1.9)).tolist()
        beyond = plan.beyond(slot)
        self._made += 1
        return Person(
            number=self._made, group=self._groups, crossing=plan.crossing, direction=plan.direction,
            size=(round(sizes[0], 2), round(sizes[1], 2), round(sizes[2], 2)),
            pace=min(max(plan.pace + float(rng.normal(0.0, 0.05)), 1.0), 1.6), patience=plan.patience,
            slot=slot, beyond=beyond, goal=beyond + plan.off, place=np.round(place, 6),
            heading=_direction((slot - place + 1e-3) @ self._axes[plan.crossing]),
        )  # fmt: skip

    def _advance(self, dt: float, free: Callable[[Walk], bool]) -> None:
        """Moves everybody on to the next stage; a group steps on the road together."""
        for p in self.people:
            if p.stage == ARRIVING and np.hypot(*(p.slot - p.place)) < 0.7:
                p.stage = WAITING
            elif p.stage == WAITING:
                p.waited += dt
            elif p.stage == CROSSING and (p.beyond[0] - p.place[0]) * p.direction < 0.3:
                p.stage = LEAVING
        groups = sorted({p.group for p in self.people if p.stage == WAITING})
        for group in groups:
            members = [p for p in self.people if p.group == group]
            if all(p.stage == WAITING for p in members) and all(free(self._walk(p)) for p in members):
                for p in members:
                    p.stage = CROSSING

    def _target(self, person: Person) -> Floats:
        return (person.slot, person.slot, person.beyond, person.goal)[person.stage]

    def _move(self, dt: float, vehicles: Floats) -> None:
        if not self.people:
            return
        place, velocity = self.xy()
        axes = np.array([self._axes[p.crossing] for p in self.people])
        origin = np.array([self._crossings[p.crossing].origin for p in self.people])
        target = np.array([self._target(p) for p in self.people])
        goal = origin + np.einsum("ni,nij->nj", target, axes)
        pace = np.array([p.pace for p in self.people])
        group = np.array([p.group for p in self.people])
        new = velocity + dt * social_force(place, velocity, goal - place, pace, group)
        speed = np.hypot(new[:, 0], new[:, 1])
        new *= np.minimum(1.0, 1.25 * pace / np.maximum(speed, 1e-9))[:, None]
        moved = kept_out(place, kept_apart(place + dt * new), vehicles)
        new = (moved - place) / dt
        for k, p in enumerate(self.people):
            p.place = np.round(axes[k] @ (moved[k] - origin[k]), 6) + 0.0
            p.velocity = np.round(axes[k] @ new[k], 6) + 0.0
            p.heading = _turned(p.heading, new[k], goal[k] - moved[k], p.stage)


def _direction(vector: Floats) -> float:
    return round(float(np.arctan2(vector[1], vector[0])), 6)


def _turned(heading: float, velocity: Floats, to_goal: Floats, stage: int) -> float:
    """The heading after a step: people turn where they walk, and look at the road while they wait."""
    if np.hypot(*velocity) > 0.3:
        wanted, share = float(np.arctan2(velocity[1], velocity[0])), 0.35
    elif stage == WAITING:
        return heading
    else:
        wanted, share = float(np.arctan2(to_goal[1], to_goal[0])), 0.1
    turn = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
    return round(float((heading + share * turn + np.pi) % (2 * np.pi) - np.pi), 6) + 0.0
