"""Pedestrians, alone or in groups: they walk along the sidewalks and cross the arms of the junction.

At the kerb they wait until no vehicle with the right of way comes in time; after a long wait vehicles wait for them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...core import Bools, Floats, wrap_angle
from . import walking
from .behaviour import PedestrianBehaviour
from .networks import Pavement, RoadMap
from .right_of_way import CrossingPedestrian
from .world import ARM_WEIGHTS

ARRIVING, WAITING, CROSSING, LEAVING = range(4)
_ROOM = 0.85  # m around a new person
_PATIENCE = (3.0, 7.0)  # s at the kerb
_HARDEST = 3.8  # m/s2, change of velocity
_NEAR, _QUEUED = 0.7, 2.0  # m to the waiting point: reached, or standing behind others
_CORNER = 2.0  # m to a point of the way, where people turn to the next one
_LOOKS = 3.0  # m before the waiting point, from where people see if they can cross
_STROLL = 0.55  # share of the groups that do not cross
_GONE = 1.4  # m to the end of the way
_CROSSED, _DONE = (
    0.25,
    0.8,
)  # of the first people: share that have crossed, largest done share of the way of others


@dataclass(eq=False)
class Person:
    """A person on foot; points are (along the crossing, across it) in metres from its origin."""

    number: int
    group: int
    crossing: int  # index into those of the map
    direction: float  # +1 or -1, along the crossing
    size: tuple[float, float, float]  # m, length, width and height
    pace: float  # m/s
    patience: float  # s at the kerb
    waiting_point: Floats
    far_point: Floats  # where to step off the road
    departure: list[Floats]  # points of the way from there
    place: list[float]
    ahead: list[Floats]  # next points of the way before the crossing, or after it
    stage: int
    passed: list[
        Floats
    ]  # passed points of the way; empty for a person who cannot turn back
    velocity: list[float] = field(
        default_factory=lambda: [0.0, 0.0]
    )  # m/s, along and across
    heading: float = 0.0  # rad
    waited: float = 0.0  # s

    @property
    def goal(self) -> Floats:
        """The present goal."""
        if self.stage == CROSSING:
            return self.far_point
        return self.waiting_point if self.stage == WAITING else self.ahead[0]


class Crowd:
    """All pedestrians of a map, at most ``most``: new ones come when others have left it."""

    def __init__(
        self,
        road_map: RoadMap,
        most: int,
        rng: np.random.Generator,
        behaviour: PedestrianBehaviour,
    ) -> None:
        self._crossings, self._pavement = road_map.crossings, road_map.pavement
        self._target, self._rng, self._behaviour = most, rng, behaviour
        self.people: list[Person] = []
        self._made = self._groups = 0
        self._xy: tuple[Floats, Floats] | None = None  # until somebody moves or comes
        self._origin = np.array([c.origin for c in self._crossings]).reshape(-1, 2)
        axes = [
            (c.direction, (-c.direction[1], c.direction[0])) for c in self._crossings
        ]  # rows: along, across
        self._axes = np.array(axes).reshape(-1, 2, 2)
        self._read()
        for _ in range(20 * most):
            if len(self.people) < most:
                stage = LEAVING if rng.uniform() < _CROSSED else ARRIVING
                self._add_group(stage, float(rng.uniform(1.0 - _DONE, 1.0)))
                behaviour.start_standing(self._groups - 1)

    def xy(self) -> tuple[Floats, Floats]:
        """Places ``[2, M]`` m and velocities ``[2, M]`` m/s in the frame of the road (y down)."""
        if self._xy is None:
            if self._known != self.people:
                self._read()
            turned = self._own[:, :1] * self._turn[0] + self._own[:, 1:] * self._turn[1]
            self._xy = self._start + turned[0], turned[1]
        return self._xy

    def _read(self) -> None:
        """Read what changes only where people come or go, and the states, which `_move` keeps up to date."""
        people = self._known = [*self.people]
        rows = [(p.number, p.group, p.crossing) for p in people]
        self._number, self._group, crossing = (
            np.array(rows, dtype=np.int64).reshape(-1, 3).T
        )
        self._start, self._turn = (
            self._origin[crossing].T,
            self._axes[crossing].transpose(1, 2, 0).copy(),
        )
        self._pace, self._heading = (
            np.array([(p.pace, p.heading) for p in people]).reshape(-1, 2).T
        )
        self._friends = (self._group[:, None] == self._group) & ~np.eye(
            len(people), dtype=bool
        )
        self._size = np.array([(p.size[2] / 2, 0.0, *p.size) for p in people]).reshape(
            -1, 5
        )  # z yaw l w h
        states = np.array(
            [(*p.place, *p.velocity) for p in people], dtype=np.float64
        ).reshape(-1, 2, 2)
        self._own = states.transpose(
            1, 2, 0
        ).copy()  # [place, velocity; along, across; M]

    def boxes(self) -> Floats:
        """Boxes ``[M, 7]`` in the frame of the road (y down)."""
        box = np.concatenate([self.xy()[0].T, self._size], axis=1)
        box[:, 3] = self._heading
        return box

    def walks(self) -> list[CrossingPedestrian]:
        """People on a crossing."""
        return [self._walk(p) for p in self.people if p.stage == CROSSING]

    def claimed(self) -> set[int]:
        """Crossings with a person at the end of its patience."""
        return {
            p.crossing
            for p in self.people
            if p.stage == WAITING and p.waited > p.patience
        }

    def step(
        self, dt: float, vehicles: Floats, free: Callable[[CrossingPedestrian], bool]
    ) -> None:
        """Move all people by ``dt`` seconds around vehicles (boxes ``[N, 7]``), and let new people come."""
        if self._pavement is None:
            return
        self.xy()  # of everybody who has come
        self._behaviour.step(sorted({p.group for p in self.people}))
        for p in self.people if self._behaviour.turning else ():
            if (
                p.group in self._behaviour.turning
                and p.passed
                and p.stage in (ARRIVING, LEAVING)
            ):
                p.ahead, p.passed, p.stage = p.passed[::-1], [], LEAVING
        self._advance(dt, free)
        self._move(dt, vehicles, self._pavement)
        remaining = zip(self.people, self._remaining().tolist(), strict=True)
        self.people = [
            p
            for p, to_end in remaining
            if p.stage != LEAVING or len(p.ahead) > 1 or to_end > _GONE
        ]
        self._xy = None
        if len(self.people) < self._target and self._rng.uniform() < dt / 1.5:
            self._add_group(ARRIVING, 1.0)

    def _walk(self, person: Person) -> CrossingPedestrian:
        patient = person.stage != CROSSING and person.waited <= person.patience
        along, speed = person.place[0], max(0.85 * person.pace, 0.5)
        return CrossingPedestrian(
            person.crossing, along, person.direction, speed, patient
        )

    def _add_group(self, stage: int, share: float) -> None:
        """Add a group on its way to a crossing or away from it; ``share``: the remaining part of that way."""
        if self._pavement is None:
            return
        rng = self._rng
        quiet = 1.0 / np.array(ARM_WEIGHTS)  # people cross quieter arms more often
        crossing = int(rng.choice(len(self._crossings), p=quiet / quiet.sum()))
        size = int(
            min(
                rng.choice(4, p=(0.5, 0.3, 0.15, 0.05)) + 1,
                self._target - len(self.people),
            )
        )
        way = walking.Footway(
            self._crossings[crossing],
            self._pavement,
            direction=1.0 if rng.uniform() < 0.5 else -1.0,
            middle=float(rng.uniform(-0.8, 0.8))
            if size == 1
            else float(rng.uniform(-0.95, 0.05)),
            coming=walking.draw_sidewalk(True, rng),
            going=walking.draw_sidewalk(False, rng),
        )
        pace, patience = float(rng.uniform(1.05, 1.55)), float(rng.uniform(*_PATIENCE))
        strolls = bool(rng.uniform() < _STROLL)
        others = self.xy()[0].T
        for k in range(size):
            points = (
                way.stroll(k)
                if strolls
                else way.arrival(k)
                if stage == ARRIVING
                else way.departure(k)
            )
            place, *ahead = walking.remaining_way(points, share)
            xy = self._origin[crossing] + place @ self._axes[crossing]
            if len(others) and np.hypot(*(others - xy).T).min() < _ROOM:
                continue
            others = np.concatenate([others, xy[None]])
            person = self._new_person(
                crossing,
                way,
                k,
                LEAVING if strolls else stage,
                place,
                ahead,
                pace,
                patience,
            )
            if strolls or stage == ARRIVING:
                person.passed = points[: -len(ahead)]
            self.people.append(person)
        self._xy = None
        self._groups += 1

    def _new_person(
        self,
        crossing: int,
        way: walking.Footway,
        k: int,
        stage: int,
        place: Floats,
        ahead: list[Floats],
        pace: float,
        patience: float,
    ) -> Person:
        rng = self._rng
        sizes = rng.uniform((0.35, 0.45, 1.5), (0.5, 0.6, 1.9)).tolist()
        own_pace = min(max(pace + float(rng.normal(0.0, 0.05)), 1.0), 1.6)
        course = (ahead[0] - place) / max(float(np.hypot(*(ahead[0] - place))), 1e-6)
        direction = course @ self._axes[crossing]
        self._made += 1
        return Person(
            number=self._made,
            group=self._groups,
            crossing=crossing,
            direction=way.direction,
            size=(round(sizes[0], 2), round(sizes[1], 2), round(sizes[2], 2)),
            pace=own_pace,
            patience=patience,
            waiting_point=way.waiting_point(k),
            far_point=way.far_point(k),
            departure=way.departure(k)[1:],
            place=place.round(6).tolist(),
            ahead=ahead,
            stage=stage,
            passed=[],
            velocity=((own_pace * course).round(6) + 0.0).tolist(),
            heading=round(float(np.arctan2(direction[1], direction[0])), 6),
        )

    def _advance(self, dt: float, free: Callable[[CrossingPedestrian], bool]) -> None:
        """Move all people on to the next stage; a group steps on the road together."""
        slow = (np.hypot(*self._own[1]) < 0.3).tolist()
        at_kerb = set()  # those who wait, or are near enough to walk on without a stop
        for p, to_next, stands in zip(
            self.people, self._remaining().tolist(), slow, strict=True
        ):
            turns = len(p.ahead) > 1 and to_next < _CORNER
            if turns:
                p.passed += p.ahead[:1] if p.passed else []
                p.ahead = p.ahead[1:]
            if (
                p.stage == ARRIVING and len(p.ahead) == 1
            ):  # the last point before the crossing
                remaining = (
                    float(np.hypot(*(p.ahead[0] - p.place))) if turns else to_next
                )
                if remaining < (_QUEUED if stands else _NEAR):
                    p.stage = WAITING
                if remaining < _LOOKS:
                    at_kerb.add(p.number)
            elif p.stage == WAITING:
                p.waited += dt
                at_kerb.add(p.number)
            elif (
                p.stage == CROSSING
                and (p.far_point[0] - p.place[0]) * p.direction < 0.2
            ):
                p.stage, p.ahead = LEAVING, p.departure
        for group in sorted(self._behaviour.ready):
            members = [p for p in self.people if p.group == group]
            if all(p.number in at_kerb for p in members) and all(
                free(self._walk(p)) for p in members
            ):
                for p in members:
                    p.stage, p.passed = CROSSING, []

    def _move(self, dt: float, vehicles: Floats, pavement: Pavement) -> None:
        if not self.people:
            return
        place, velocity = self.xy()
        goals = _points([p.goal for p in self.people])
        goal = self._start + (goals[0] * self._turn[0] + goals[1] * self._turn[1])
        stage = np.array([p.stage for p in self.people])
        beside = stage != CROSSING
        way, pace = self._behaviour.walk(
            goal - place, self._pace, self._number, self._group, ~beside
        )
        pairs, outlines = walking.pairs_of(place), walking.Outlines(vehicles, place)
        force = walking.social_force(pairs, velocity, way, pace, self._friends)
        new = walking.limit_length(velocity + dt * force, 1.25 * pace)
        new = walking.slow_before_others(place, pairs, new, outlines, dt)
        new = walking.slow_at_kerb(place, new, pavement, beside)
        new = velocity + walking.limit_length(new - velocity, _HARDEST * dt)
        moved = walking.keep_off_road(
            walking.push_apart(place + dt * new), pavement, beside
        )
        moved = walking.keep_out_of_vehicles(place, moved, outlines)
        new = (moved - place) / dt
        states = np.array([moved - self._start, new])
        self._own = (
            states[:, :1] * self._turn[:, 0] + states[:, 1:] * self._turn[:, 1]
        ).round(6) + 0.0
        self._heading = _turned_headings(
            self._heading, new, goal - moved, stage == WAITING
        )
        rows = zip(
            self.people,
            *self._own.transpose(0, 2, 1).tolist(),
            self._heading.tolist(),
            strict=True,
        )
        for person, *state in rows:
            person.place, person.velocity, person.heading = state

    def _remaining(self) -> Floats:
        """Metres ``[M]`` to the next point of the way of each."""
        way = _points([p.ahead[0] for p in self.people]) - self._own[0]
        return np.asarray(np.hypot(way[0], way[1]))


def _points(rows: list[Floats]) -> Floats:
    """An array ``[2, n]`` of points."""
    return np.concatenate([np.empty(0), *rows]).reshape(-1, 2).T


def _turned_headings(
    heading: Floats, velocity: Floats, to_goal: Floats, waiting: Bools
) -> Floats:
    """Headings ``[M]`` after a step: people look where they walk, and at the road while they wait."""
    walks = np.hypot(*velocity) > 0.3
    x, y = np.where(walks, velocity, to_goal)
    turn = wrap_angle(np.arctan2(y, x) - heading)
    turned = wrap_angle(heading + np.where(walks, 0.35, 0.1) * turn)
    return np.where(walks | ~waiting, turned.round(6) + 0.0, heading)
