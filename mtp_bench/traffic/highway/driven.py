"""Traffic with an ego that is driven from outside: it keeps to its way, and others react to it."""

from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...core import DataError, Floats, Ints, unit_vectors
from .lanes import NO_LANE, RouteTable
from .networks import RoadMap
from .recording import Recording
from .simulate import ATTEMPTS, HARDEST, Attempt, boxes_meet, overlapping
from .vehicles import Driver
from .world import CLASSES, RATE, WARM_UP, Traffic, World

_STEP = 0.5  # m between two points of a way
_SHIFT = (
    15.0,
    75.0,
)  # m from the start of a road, where a way changes to the lane that goes on
_AWAY = (
    (8.0, 60.0),
    (60.0, 200.0),
)  # m from the place where the ego meets the others, at junctions and on ramps
_WAIT = 20.0  # s after the warm-up, in which a vehicle may become the ego
_NEAREST = 3  # vehicles among which the ego is drawn
_LONGEST = 5.6  # m, of the ego
STANDING = 0.05  # m/s: nuPlan's threshold


@dataclass(frozen=True, eq=False)
class Way:
    """The way of the ego; right-handed frame, z up."""

    s: Floats  # [n] m along it
    xy: Floats  # [n, 2]
    heading: Floats  # [n] rad, without jumps
    limit: Floats  # [n] m/s
    lane: Ints  # [n] numbers of the lanes

    def at(self, s: Floats) -> tuple[Floats, Floats]:
        """Places ``[..., 2]`` and headings ``[...]`` at ``s`` m."""
        place = np.stack(
            [np.interp(s, self.s, self.xy[:, axis]) for axis in range(2)], axis=-1
        )
        return place, np.interp(s, self.s, self.heading)


@dataclass(frozen=True)
class Collision:
    """The first contact of the ego."""

    class_id: int  # index into `world.CLASSES`
    number: int  # of the road user
    at_fault: (
        bool  # the ego moved, and was not hit from behind (docs/definitions/driving.md)
    )


class _Ego(Driver):
    """A vehicle that follows its way exactly, at the acceleration that it is given."""

    def follow(self, way: Way, s: float) -> None:
        """Take the way, at ``s`` m."""
        self.way, self.s, self.wanted = way, s, 0.0
        self._place()

    def drive(self) -> tuple[float, ...]:
        """Move along the way for 1 / `RATE` seconds, without the driver model."""
        dt, speed = 1.0 / RATE, float(self.speed)
        gain = max(self.wanted, -speed / dt)
        self.s = min(self.s + speed * dt, float(self.way.s[-1]))
        self._place()
        return *self.position, self.heading, speed + gain * dt, gain

    def _place(self) -> None:
        x, y = (
            float(np.interp(self.s, self.way.s, column)) for column in self.way.xy.T
        )
        self.position, self.heading = (
            (x, -y),
            -float(np.interp(self.s, self.way.s, self.way.heading)),
        )
        self.lane_number = int(
            self.way.lane[self.way.s.searchsorted(self.s, "right") - 1]
        )


class DrivenTraffic:
    """Traffic of a seed whose ego takes an acceleration at each of its `RATE` steps per second.

    The ego is a car that comes to the junction, or along the ramp, when the recording begins; it takes the rarest way
    from there, such as a left turn. Equal accelerations give the same bits. Raises DataError if no attempt has an ego.
    """

    def __init__(self, traffic: Traffic, seed: int) -> None:
        attempt, ego = _warmed_up(traffic, seed)
        self._attempt, self.ego = deepcopy(
            (attempt, ego), {id(each): each for each in (*attempt.shared, ego.way)}
        )
        self.lanes = self._attempt.lanes
        self._recording = Recording(self._attempt.parked)
        self.frames = 0
        self.collision: Collision | None = None
        self._record()

    @property
    def way(self) -> Way:
        """The way of the ego."""
        return self.ego.way

    @property
    def size(self) -> tuple[float, float]:
        """Length and width of the ego, m."""
        return self.ego.traits.length, self.ego.traits.width

    @property
    def at_goal(self) -> bool:
        """True at the end of the way."""
        return bool(self.ego.s >= self.way.s[-1] - 1.0)

    @property
    def over(self) -> bool:
        """True after a collision, or at the goal."""
        return self.collision is not None or self.at_goal

    def step(self, acceleration: float) -> None:
        """Drive for 1 / `RATE` seconds at ``acceleration`` m/s2, from -`simulate.HARDEST` up, and record the frame."""
        self.ego.wanted = max(float(acceleration), -HARDEST)
        self._attempt.step(self._vehicles)
        if (
            self.ego not in self._attempt.vehicles
        ):  # at the end of its route it would leave
            self._attempt.vehicles.append(self.ego)
        self._record()

    def world(self, last: bool = False, frames: int | None = None) -> World:
        """The frames so far, the first ``frames`` of them, or only the ``last`` one; objects keep their numbers."""
        return self._recording.seen_from(self.ego.number, self.lanes, last, frames)

    def _record(self) -> None:
        self._vehicles, people, parked = self._attempt.boxes()
        vehicles = self._vehicles
        self._recording.add(
            self._attempt.vehicles, vehicles, self._attempt.crowd, people
        )
        self.frames += 1
        own = self._attempt.vehicles.index(self.ego)
        every = np.concatenate([vehicles, people, parked])
        reach = np.hypot(every[:, 4], every[:, 5]) / 2
        (x, y), (own_x, own_y) = every[:, :2].T, every[own, :2]
        near = np.flatnonzero(np.hypot(x - own_x, y - own_y) < reach + reach[own])
        near = near[near != own]
        met = (
            near[boxes_meet(every[near], every[np.full(len(near), own)])].tolist()
            if len(near)
            else []
        )
        if met and self.collision is None:
            faults = [
                other
                for other in met
                if is_at_fault(every[own], float(self.ego.speed), every[other])
            ]
            kind, number = self._recording.identity((faults or met)[0])
            self.collision = Collision(kind, number, bool(faults))


@lru_cache(maxsize=256)  # of 50 kB: more than the scenes of a split
def _warmed_up(traffic: Traffic, seed: int) -> tuple[Attempt, _Ego]:
    """The first frame of a drive, kept to be copied: agents drive in the same scenes, one after the other."""
    for number in range(ATTEMPTS):
        attempt = Attempt(traffic, seed, number)
        found = _ego_after_warm_up(attempt, np.random.default_rng([seed, number, 6]))
        if found is not None:
            if attempt.drivers.rules is not None:
                attempt.drivers.rules.driven = found.number
            return attempt, found
    raise DataError(
        f"{traffic.scenario}, seed {seed}: no vehicle can be the ego in {ATTEMPTS} attempts"
    )


def _ego_after_warm_up(attempt: Attempt, rng: np.random.Generator) -> _Ego | None:
    """Simulate the warm-up, and on until a vehicle can be the ego; None after a crash, or a wait of `_WAIT` s."""
    for step in range(round((WARM_UP + _WAIT) * RATE)):
        boxes = attempt.boxes()
        if len(overlapping(np.concatenate(boxes), len(boxes[2]))):
            return None
        if step >= WARM_UP * RATE and (found := _choose(attempt, rng)) is not None:
            return found
        attempt.step(boxes[0])
    return None


def _choose(attempt: Attempt, rng: np.random.Generator) -> _Ego | None:
    """Put the ego in the place of a car that is about to meet the others; None without one."""
    found = []
    least, most = _AWAY[0 if attempt.map.regulated else 1]
    for place, driver in enumerate(attempt.vehicles):
        if (
            driver.traits.class_id != CLASSES.index("car")
            or driver.traits.length > _LONGEST
        ):
            continue
        if (
            not attempt.map.regulated
            and len(attempt.map.routes[driver.route].roads) < 4
        ):  # not on the ramp
            continue
        s = float(attempt.routes.start[driver.route, driver.lane_number])
        s += float(
            attempt.map.geometry.lanes[driver.lane_number].local_coordinates(
                driver.position
            )[0]
        )
        away = meeting_place(attempt, driver.route) - s - driver.traits.length / 2
        if least < away < most:
            found.append((away, place, s))
    if not found:
        return None
    _, place, s = sorted(found)[int(rng.integers(min(_NEAREST, len(found))))]
    driver = attempt.vehicles[place]
    first = attempt.map.routes[driver.route].roads[0]
    # the rarest way: left turns and merges meet more road users than the way straight on, which most drivers take
    same = [r for r, route in enumerate(attempt.map.routes) if route.roads[0] == first]
    route = min(same, key=lambda r: attempt.map.routes[r].weight)
    ego = _Ego(
        driver.position, driver.heading, driver.speed, driver.traits, driver.number
    )
    ego.route, attempt.vehicles[place] = route, ego
    ego.follow(way_of(attempt.map, attempt.routes, route), s)
    return ego


def meeting_place(attempt: Attempt, route: int) -> float:
    """Metres from the start of a route to where it meets others: the line to wait at, or the end of a ramp."""
    rules = attempt.drivers.rules
    if rules is not None:
        return rules.passages[route].line
    roads = attempt.map.routes[route].roads
    return float(attempt.routes.start[route, roads[-2][-1]])


def way_of(road_map: RoadMap, routes: RouteTable, route: int) -> Way:
    """The way along the middle of the lanes of a ``route`` (its index), with points every 0.5 m.

    Where a lane ends it changes to the one that goes on, between 15 and 75 m after the start of the road.
    """
    geometry, roads = road_map.geometry, road_map.routes[route].roads
    parts, lane = [], roads[0][-1]
    for place, road in enumerate(roads):
        lane = lane if place == 0 else int(routes.following[route, lane])
        goes_on = place == len(roads) - 1 or routes.following[route, lane] != NO_LANE
        after = (
            lane
            if goes_on
            else next(
                k for k in reversed(road) if routes.following[route, k] != NO_LANE
            )
        )
        stations = np.arange(0.0, geometry.length[lane], _STEP)
        share = np.clip((stations - _SHIFT[0]) / (_SHIFT[1] - _SHIFT[0]), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share) * (after != lane)
        here, there = (
            np.array([geometry.lanes[k].position(float(s), 0.0) for s in stations])
            for k in (lane, after)
        )
        xy = here + share[:, None] * (there - here)
        number = np.where(share > 0.5, after, lane)
        limit = np.full(len(stations), geometry.limit[lane])
        parts.append(
            (routes.start[route, lane] + stations, xy * [1.0, -1.0], limit, number)
        )
        lane = after
    s, xy, limit, number = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    along = np.gradient(xy, axis=0)
    return Way(s, xy, np.unwrap(np.arctan2(along[:, 1], along[:, 0])), limit, number)


def is_at_fault(ego: Floats, speed: float, other: Floats) -> bool:
    """True for a contact of boxes ``[7]`` at ``speed`` m/s of the ego unless it stood, or was hit from behind."""
    return speed > STANDING and not hit_from_behind(ego, other)


def hit_from_behind(ego: Floats, other: Floats) -> bool:
    """True if the ``other`` box ``[7]`` touches the rear of the ego, and not its front."""
    away = other[:2] - ego[:2]
    ahead = away @ unit_vectors(ego[3])
    turn = other[3] - ego[3]
    reach = (abs(np.cos(turn)) * other[4] + abs(np.sin(turn)) * other[5]) / 2
    return bool(ahead < 0 and ahead + reach < ego[4] / 2 and np.cos(turn) > 0.5)
