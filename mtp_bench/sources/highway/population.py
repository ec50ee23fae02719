"""Who drives: vehicles with a size and a temper of their own, drawn at random, and the places where they come in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from ...types import Floats
from . import plans
from .networks import RoadMap
from .routes import Route
from .world import CLASSES

_KINDS = ("car", "van", "motorcycle", "truck", "bus")
_SHARES = {"urban": (0.66, 0.12, 0.10, 0.07, 0.05), "fast": (0.62, 0.13, 0.05, 0.17, 0.03)}
# mean and spread of length, width, height; the least and the largest length
_SIZES = {
    "car": ((4.5, 0.3), (1.82, 0.07), (1.52, 0.09), (3.6, 5.2)),
    "van": ((5.3, 0.4), (1.98, 0.06), (2.05, 0.2), (4.7, 6.4)),
    "motorcycle": ((2.15, 0.12), (0.8, 0.06), (1.5, 0.1), (1.8, 2.5)),
    "truck": ((8.6, 1.6), (2.46, 0.06), (3.3, 0.3), (6.5, 12.0)),
    "bus": ((11.4, 0.7), (2.52, 0.03), (3.15, 0.12), (9.5, 12.5)),
}
LONG = 6.6  # m, longer vehicles do not turn at the intersection
_TRIES = 6  # steps that a vehicle waits for room; then somebody else comes
_LANE_WIDE = 2.5  # m from the middle of a lane: who is nearer is in it
_SHARE = 0.6  # of the time gap that a vehicle comes in with
_FIRST_ROOM = 10.0  # m, least space between two vehicles that are there from the start


@dataclass(frozen=True)
class Profile:
    """What a vehicle is and how it is driven."""

    class_id: int
    length: float  # m
    width: float
    height: float
    wheelbase: float
    pace: float  # desired speed as a share of the limit
    top_speed: float  # m/s
    time_gap: float  # s
    min_gap: float  # m, to a standing leader
    acceleration: float  # m/s2
    braking: float  # m/s2, comfortable
    politeness: float  # 0 selfish, 1 counts others like itself
    aside: float  # m, how far right of the middle of the lane it keeps


class Driver(Vehicle):  # type: ignore[misc]
    """A vehicle that does what its last ``act`` says: steering angle in rad, acceleration in m/s2.

    ``LENGTH`` is the wheelbase, which is what highway-env's bicycle model turns by; the box has its own size in
    ``profile``. highway-env's collision handling is off (its response would move the vehicles): overlaps are judged by
    `simulate.overlapping`. The lane is kept by number, for all vehicles at once, see `state.observe`.
    """

    position: Any  # [2] m
    heading: Any
    speed: Any
    action: Any  # steering and acceleration of the last step

    def __init__(
        self, road: Any, position: Floats, heading: float, speed: float, profile: Profile, number: int
    ) -> None:
        nowhere: Any = None  # highway-env would search the nearest of all lanes
        super().__init__(nowhere, position, heading, speed)
        self.road = road
        self.LENGTH, self.WIDTH = profile.wheelbase, profile.width
        self.check_collisions = False
        self.impact = None
        self.profile = profile
        self.number = number  # never used twice in a world
        self.route = -1
        self.lane_number = -1
        p = profile
        self.traits = (p.length, p.width, p.wheelbase, p.pace, p.top_speed, p.time_gap, p.min_gap, p.acceleration,
                       p.braking, p.politeness, p.aside)  # fmt: skip

    def on_state_update(self) -> None:
        """Nothing: the lane is found for all vehicles at once."""


def snap(vehicles: Sequence[Driver]) -> None:
    """Rounds states to 1e-6, so that the last bits of a processor's arithmetic cannot grow."""
    place = np.round(np.array([v.position for v in vehicles], dtype=np.float64).reshape(-1, 2), 6) + 0.0
    heading = np.remainder(np.array([v.heading for v in vehicles], dtype=np.float64) + np.pi, 2 * np.pi) - np.pi
    for vehicle, position, angle in zip(vehicles, place, heading.tolist(), strict=True):
        vehicle.position, vehicle.heading = position, round(angle, 6) + 0.0
        vehicle.speed = round(float(vehicle.speed), 6) + 0.0


def draw_profile(fast: bool, rng: np.random.Generator) -> Profile:
    """A vehicle and its driver; ``fast``: for a motorway, where there are more trucks."""
    kind = _KINDS[int(rng.choice(len(_KINDS), p=_SHARES["fast" if fast else "urban"]))]
    size, width, height = draw_size(kind, rng)
    heavy = kind in ("truck", "bus")
    gap = float(np.clip(np.exp(rng.normal(-0.32, 0.5)), 0.3, 2.4))
    return Profile(
        class_id=CLASSES.index("car" if kind == "van" else kind),
        length=round(size, 2),
        width=round(width, 2),
        height=round(height, 2),
        wheelbase=round((0.55 if heavy else 0.6) * size, 2),
        pace=round(float(np.clip(rng.normal(0.88 if heavy else 0.98, 0.14), 0.6, 1.3)), 6),
        top_speed=23.5 if heavy else 40.0,
        time_gap=round(max(gap, 0.8) if heavy else gap, 6),
        min_gap=float(rng.uniform(0.6, 1.6)),
        acceleration=float(rng.uniform(0.8, 1.3) if heavy else rng.uniform(1.2, 2.2)),
        braking=float(rng.uniform(1.6, 2.6)),
        politeness=float(rng.uniform(0.0, 0.6)),
        aside=float(rng.uniform(-0.5, 0.5) if kind == "motorcycle" else rng.uniform(-0.2, 0.2)),
    )


def draw_size(kind: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Length, width and height of a vehicle, m."""
    length, width, height, (least, most) = _SIZES[kind]
    return (
        float(np.clip(rng.normal(*length), least, most)),
        float(np.clip(rng.normal(*width), width[0] - 0.25, min(width[0] + 0.25, 2.55))),
        float(np.clip(rng.normal(*height), 0.8 * height[0], 1.25 * height[0])),
    )


class Gate:
    """Where vehicles come in: keeps the road at the number of vehicles that is aimed at."""

    def __init__(self, town: RoadMap, vehicles: int, rng: np.random.Generator) -> None:
        self._map, self._aim, self._rng = town, vehicles, rng
        self._made = 0
        self._next: tuple[Profile, int] | None = None  # waits until there is room
        self._tries = 0

    def fill(self, road: Any) -> None:
        """Puts the first vehicles on the first part of the entry lanes, and some on the exit lanes."""
        junction, leaving = self._map.regulated, plans.LEAVING * self._map.regulated
        for _ in range(20 * self._aim):
            if len(road.vehicles) >= self._aim:
                return
            profile, route = self._draw()
            lane = self._lanes(profile, route)[0]
            part = plans.FILLED[0 if junction else 1]
            if leaving and self._rng.uniform() < leaving:
                lane, part = self._map.routes[route].roads[-1][0], 0.9
            at = float(self._rng.uniform(profile.length / 2, part * self._map.geometry.length[lane]))
            self._enter(road, profile, route, lane, at, _FIRST_ROOM)

    def admit(self, road: Any, finished: Sequence[Driver]) -> None:
        """Takes out those who are ``finished`` and lets at most one other in, where there is room."""
        for vehicle in finished:
            road.vehicles.remove(vehicle)
        if len(road.vehicles) >= self._aim:
            return
        if self._next is None or self._tries >= _TRIES:
            self._next, self._tries = self._draw(), 0
        profile, route = self._next
        self._tries += 1
        for lane in self._lanes(profile, route):
            if self._enter(road, profile, route, lane, profile.length / 2 + 0.5, profile.min_gap + 2.0):
                self._next = None
                return

    def _draw(self) -> tuple[Profile, int]:
        routes: tuple[Route, ...] = self._map.routes
        profile = draw_profile(self._map.overtaking, self._rng)
        weight = np.array([r.weight if r.heavy or profile.length < LONG else 0.0 for r in routes])
        return profile, int(self._rng.choice(len(routes), p=weight / weight.sum()))

    def _lanes(self, profile: Profile, route: int) -> list[int]:
        """The lanes that the vehicle may come in on, in the order in which it tries them."""
        lanes = self._map.routes[route].roads[0]
        if profile.top_speed < self._map.geometry.limit[lanes[0]]:
            return [lanes[-1]]
        return [lanes[int(k)] for k in self._rng.permutation(len(lanes))]

    def _enter(self, road: Any, profile: Profile, route: int, lane: int, at: float, room: float) -> bool:
        speed = self._free_speed(road, profile, lane, at, room)
        if speed is None:
            return False
        way = self._map.geometry.lanes[lane]
        position = np.asarray(way.position(at, profile.aside), dtype=np.float64)
        vehicle = Driver(road, position, float(way.heading_at(at)), speed, profile, self._made)
        vehicle.route, vehicle.lane_number = route, lane
        snap([vehicle])
        road.vehicles.append(vehicle)
        self._made += 1
        return True

    def _free_speed(self, road: Any, profile: Profile, lane: int, at: float, room: float) -> float | None:
        """Speed to come in with at a place in a lane; None: there is no room."""
        way = self._map.geometry.lanes[lane]
        speed = min(profile.pace * float(self._map.geometry.limit[lane]), profile.top_speed)
        for other in road.vehicles:
            s, d = way.local_coordinates(other.position)
            if abs(d) > _LANE_WIDE:
                continue
            gap = abs(s - at) - (other.profile.length + profile.length) / 2
            if gap < room + (_SHARE * profile.time_gap * speed if s > at else 0.0):
                return None
            if s > at:  # slow enough to brake behind the one ahead
                speed = min(speed, float(np.sqrt(other.speed**2 + 2.0 * max(gap - room, 0.0))))
        return speed


def boxes(vehicles: Sequence[Driver]) -> Floats:
    """Boxes ``[n, 7]`` of vehicles in highway-env's frame (y down)."""
    sizes = [(v.profile.length, v.profile.width, v.profile.height) for v in vehicles]
    rows = [(*v.position.tolist(), h / 2, v.heading, l, w, h) for v, (l, w, h) in zip(vehicles, sizes, strict=True)]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)
