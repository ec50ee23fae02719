"""Pedestrians, alone or in groups, on sidewalks and on the crossings of a junction.

At the kerb they wait until no vehicle with the right of way comes in time; after a long
wait vehicles wait for them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats, wrap_angle
from . import walking
from .behaviour import PedestrianBehaviour
from .lanes import Pavement, RoadMap
from .person import ARRIVING, CROSSING, LEAVING, WAITING, Person
from .right_of_way import CrossingPedestrian
from .world import ARM_WEIGHTS

_MAX_GROUP = 4
_GROUP_SHARES = (0.5, 0.3, 0.15, 0.05)  # of groups of one, two, ... people
_FREE_M = 0.85  # around a new person
_PATIENCE_S = (3.0, 7.0)  # at the kerb
_GROUP_PACE_MPS = (1.05, 1.55)
_PACE_SPREAD_MPS = 0.05  # within a group
_PACE_LIMITS_MPS = (1.0, 1.6)
_MAX_PACE_SHARE = 1.25  # of the pace, the highest speed
# length, width and height of the smallest and the largest person, m
_SMALLEST_M = (0.35, 0.45, 1.5)
_LARGEST_M = (0.5, 0.6, 1.9)
# between the middle of a crossing and the way of one person, and of a group
_MIDDLE_M = (-0.8, 0.8)
_GROUP_MIDDLE_M = (-0.95, 0.05)
# share of a turn in one step, of people who walk and who wait
_WALKING_TURN_SHARE = 0.35
_WAITING_TURN_SHARE = 0.1
_MAX_ACCELERATION_MPS2 = 3.8
_MIN_WALKING_MPS = 0.3  # slower people stand
_STROLL_SHARE = 0.55  # of the groups, which do not cross
# people at the start of a scene: share that have crossed already, and the largest
# share of the way that the others have passed
_CROSSED_SHARE = 0.25
_MAX_PASSED_SHARE = 0.8
_ARRIVAL_S = 1.5  # mean time until a missing person comes


class CrowdState(NamedTuple):
    """Places and velocities of M people."""

    local: Floats  # [place and velocity; along and across; M]
    axes: Floats  # [along and across; x and y; M]
    origin: Floats  # [2, M] m
    xy: Floats  # [2, M] m, in highway-env's frame
    velocity: Floats  # [2, M] m/s


class Crowd:
    """All pedestrians of a map: new ones come when others have left it."""

    def __init__(
        self,
        road_map: RoadMap,
        target_count: int,
        rng: np.random.Generator,
        behaviour: PedestrianBehaviour,
    ) -> None:
        """``target_count``: number of people to keep, at most."""
        crossings = road_map.crossings
        self._crossings = crossings
        self._pavement = road_map.pavement
        self._target = target_count
        self._rng = rng
        self._behaviour = behaviour
        self.people: list[Person] = []
        self._people_count = 0
        self._groups = 0
        self._origins = np.array([c.origin for c in crossings]).reshape(-1, 2)
        along = np.array([c.direction for c in crossings]).reshape(-1, 2)
        across = along[:, ::-1] * [-1.0, 1.0]
        self._axes = np.stack([along, across], axis=1)
        self._state: CrowdState | None = None  # until a person moves or comes
        for _ in range(20 * target_count):  # some groups find no free place
            if len(self.people) < target_count:
                stage = LEAVING if rng.uniform() < _CROSSED_SHARE else ARRIVING
                way_share = float(rng.uniform(1.0 - _MAX_PASSED_SHARE, 1.0))
                self._add_group(stage, way_share)
                behaviour.start_standing(self._groups - 1)

    def state(self) -> CrowdState:
        """Return the places and velocities of all people."""
        if self._state is None:
            rows = [(*p.place, *p.velocity) for p in self.people]
            local = np.array(rows, dtype=np.float64).reshape(-1, 2, 2)
            local = local.transpose(1, 2, 0).copy()
            crossing = np.array([p.crossing for p in self.people], dtype=np.int64)
            axes = self._axes[crossing].transpose(1, 2, 0)
            origin = self._origins[crossing].T
            offset, velocity = local[:, :1] * axes[0] + local[:, 1:] * axes[1]
            self._state = CrowdState(local, axes, origin, origin + offset, velocity)
        return self._state

    def boxes(self) -> Floats:
        """Return boxes [M, 7] in highway-env's frame (y down)."""
        rows = [(p.size[2] / 2, p.heading, *p.size) for p in self.people]
        sizes = np.array(rows, dtype=np.float64).reshape(-1, 5)
        return np.concatenate([self.state().xy.T, sizes], axis=1)

    def walks(self) -> list[CrossingPedestrian]:
        """Return the people on a crossing."""
        return [p.walk() for p in self.people if p.stage == CROSSING]

    def claimed(self) -> set[int]:
        """Return crossings with a person at the end of the patience."""
        waiting = [p for p in self.people if p.stage == WAITING]
        return {p.crossing for p in waiting if not p.patient}

    def step(
        self,
        step_s: float,
        vehicles: Floats,
        is_free: Callable[[CrossingPedestrian], bool],
    ) -> None:
        """Move all people by ``step_s`` seconds around vehicles (boxes [N, 7]).

        ``is_free``: true if a person can cross. New people come.
        """
        if self._pavement is None:
            return
        self._behaviour.step(sorted({p.group for p in self.people}))
        for p in self.people:
            if p.group in self._behaviour.turning:
                p.turn_back()
        self._advance(step_s, is_free)
        self._move(step_s, vehicles, self._pavement)
        to_next = self._to_next_point()
        remaining = zip(self.people, to_next, strict=True)
        self.people = [p for p, to_end in remaining if not p.has_left(to_end)]
        self._state = None
        missing = len(self.people) < self._target
        if missing and self._rng.uniform() < step_s / _ARRIVAL_S:
            self._add_group(ARRIVING, way_share=1.0)

    def _add_group(self, stage: int, way_share: float) -> None:
        """Add a group on its way.

        ``way_share``: the remaining share of that way. A person without a free place is
        left out.
        """
        if self._pavement is None:
            return
        rng = self._rng
        crossing, size, way = self._draw_way(self._pavement)
        pace_mps = float(rng.uniform(*_GROUP_PACE_MPS))
        patience_s = float(rng.uniform(*_PATIENCE_S))
        strolls = bool(rng.uniform() < _STROLL_SHARE)
        other_places = self.state().xy.T
        for member_index in range(size):
            if strolls:
                points = way.stroll(member_index)
            else:
                points = (
                    way.arrival(member_index)
                    if stage == ARRIVING
                    else way.departure(member_index)
                )
            place, *ahead = walking.remaining_way(points, way_share)
            start_xy = self._origins[crossing] + place @ self._axes[crossing]
            if (
                len(other_places)
                and np.hypot(*(other_places - start_xy).T).min() < _FREE_M
            ):
                continue
            other_places = np.concatenate([other_places, start_xy[None]])
            person = self._new_person(
                crossing, way, member_index, place, ahead, pace_mps, patience_s
            )
            person.stage = LEAVING if strolls else stage
            if strolls or stage == ARRIVING:
                person.passed = points[: -len(ahead)]
            self.people.append(person)
        self._state = None
        self._groups += 1

    def _draw_way(self, pavement: Pavement) -> tuple[int, int, walking.Footway]:
        """Draw the crossing, the size and the way of a group."""
        rng = self._rng
        quiet = 1.0 / np.array(ARM_WEIGHTS)  # people cross quieter arms more often
        crossing = int(rng.choice(len(self._crossings), p=quiet / quiet.sum()))
        size = int(rng.choice(_MAX_GROUP, p=_GROUP_SHARES) + 1)
        size = min(size, self._target - len(self.people))
        middle_range_m = _MIDDLE_M if size == 1 else _GROUP_MIDDLE_M
        way = walking.Footway(
            self._crossings[crossing],
            pavement,
            direction=1.0 if rng.uniform() < 0.5 else -1.0,
            middle=float(rng.uniform(*middle_range_m)),
            coming=walking.draw_sidewalk(coming=True, rng=rng),
            going=walking.draw_sidewalk(coming=False, rng=rng),
        )
        return crossing, size, way

    def _new_person(
        self,
        crossing: int,
        way: walking.Footway,
        member_index: int,
        place: Floats,
        ahead: list[Floats],
        pace_mps: float,
        patience_s: float,
    ) -> Person:
        """Draw person ``member_index`` of a group."""
        rng = self._rng
        length, width, height = rng.uniform(_SMALLEST_M, _LARGEST_M).tolist()
        slowest, fastest = _PACE_LIMITS_MPS
        pace_mps += float(rng.normal(0.0, _PACE_SPREAD_MPS))
        pace_mps = min(max(pace_mps, slowest), fastest)
        step = ahead[0] - place
        course = step / max(float(np.hypot(*step)), 1e-6)
        x, y = course @ self._axes[crossing]
        self._people_count += 1
        return Person(
            number=self._people_count,
            group=self._groups,
            crossing=crossing,
            direction=way.direction,
            size=(round(length, 2), round(width, 2), round(height, 2)),
            pace=pace_mps,
            patience=patience_s,
            waiting_point=way.waiting_point(member_index),
            far_point=way.far_point(member_index),
            departure=way.departure(member_index)[1:],
            place=place.round(6).tolist(),
            velocity=((pace_mps * course).round(6) + 0.0).tolist(),
            heading=round(float(np.arctan2(y, x)), 6),
            ahead=ahead,
        )

    def _advance(
        self, step_s: float, is_free: Callable[[CrossingPedestrian], bool]
    ) -> None:
        """Move all people on to the next stage.

        A group steps on the road together.
        """
        speeds = np.hypot(*self.state().local[1]).tolist()
        at_kerb = set()
        for p, to_next, speed_mps in zip(
            self.people, self._to_next_point(), speeds, strict=True
        ):
            if p.advance(p.turn_corner(to_next), speed_mps < _MIN_WALKING_MPS, step_s):
                at_kerb.add(p.number)
        for group in sorted(self._behaviour.ready):
            members = [p for p in self.people if p.group == group]
            if all(p.number in at_kerb and is_free(p.walk()) for p in members):
                for p in members:
                    p.stage = CROSSING
                    p.passed = []

    def _move(self, step_s: float, vehicles: Floats, pavement: Pavement) -> None:
        """Move all people by ``step_s`` seconds, by social forces."""
        if not self.people:
            return
        local, axes, origin, place, velocity = self.state()
        goals = _points([p.goal for p in self.people])
        goal_xy = origin + (goals[0] * axes[0] + goals[1] * axes[1])
        stage = np.array([p.stage for p in self.people])
        numbers = np.array([p.number for p in self.people])
        groups = np.array([p.group for p in self.people])
        friends = groups[:, None] == groups
        np.fill_diagonal(friends, False)
        is_off_road = stage != CROSSING
        pace_mps = np.array([p.pace for p in self.people])
        way, pace_mps = self._behaviour.walk(
            goal_xy - place, pace_mps, numbers, groups, ~is_off_road
        )
        pairs = walking.pairs_of(place)
        outlines = walking.Outlines(vehicles, place)
        force = walking.social_force(pairs, velocity, way, pace_mps, friends)
        new_velocity = walking.limit_length(
            velocity + step_s * force, _MAX_PACE_SHARE * pace_mps
        )
        new_velocity = walking.slow_before_others(
            place, pairs, new_velocity, outlines, step_s
        )
        new_velocity = walking.slow_at_kerb(place, new_velocity, pavement, is_off_road)
        change = walking.limit_length(
            new_velocity - velocity, _MAX_ACCELERATION_MPS2 * step_s
        )
        moved_xy = walking.push_apart(place + step_s * (velocity + change))
        moved_xy = walking.keep_off_road(moved_xy, pavement, is_off_road)
        moved_xy = walking.keep_out_of_vehicles(place, moved_xy, outlines)
        new_velocity = (moved_xy - place) / step_s
        states = np.array([moved_xy - origin, new_velocity])
        local = states[:, :1] * axes[:, 0] + states[:, 1:] * axes[:, 1]
        places, velocities = (local.round(6) + 0.0).transpose(0, 2, 1).tolist()
        heading = np.array([p.heading for p in self.people])
        heading = _turned_headings(
            heading, new_velocity, goal_xy - moved_xy, stage == WAITING
        )
        for i, p in enumerate(self.people):
            p.place = places[i]
            p.velocity = velocities[i]
            p.heading = float(heading[i])
        self._state = None

    def _to_next_point(self) -> list[float]:
        """Return each person's metres to the next point."""
        x, y = _points([p.ahead[0] for p in self.people]) - self.state().local[0]
        distance: list[float] = np.hypot(x, y).tolist()
        return distance


def _points(rows: list[Floats]) -> Floats:
    """Return an array [2, n] of points."""
    return np.concatenate([np.empty(0), *rows]).reshape(-1, 2).T


def _turned_headings(
    heading: Floats, velocity: Floats, to_goal: Floats, waiting: Bools
) -> Floats:
    """Return headings [M] after a step.

    People look where they walk, and at the road while they wait.
    """
    walks = np.hypot(*velocity) > _MIN_WALKING_MPS
    x, y = np.where(walks, velocity, to_goal)
    turn = wrap_angle(np.arctan2(y, x) - heading)
    turn_share = np.where(walks, _WALKING_TURN_SHARE, _WAITING_TURN_SHARE)
    new_heading = wrap_angle(heading + turn_share * turn)
    return np.where(walks | ~waiting, new_heading.round(6) + 0.0, heading)
