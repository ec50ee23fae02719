"""Traffic with an ego that is driven from outside.

The ego keeps to its way, and others react to it.
"""

from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import KDTree

from ...core import DataError, Floats, Ints, boxes_meet, unit_vectors
from .lanes import NO_LANE, RoadMap, RouteTable, lane_points
from .simulate import ATTEMPTS, MAX_BRAKING_MPS2, RANDOM_KINDS, Attempt
from .vehicles import Driver
from .world import CLASSES, RATE, WARM_UP, Recording, Traffic, World

REACH_M = 9.0  # from a way, beyond which places have no station on it
_CELL_M = 1.0  # of the grid that finds the station next to a place
_POINT_STEP_M = 0.5  # between two points of a way
# from the start of a road, where a way changes to the lane that goes on
_CHANGE_START_M = 15.0
_CHANGE_END_M = 75.0
# from the place where the ego meets the others
_JUNCTION_DISTANCE_M = (8.0, 60.0)
_RAMP_DISTANCE_M = (60.0, 200.0)
_RAMP_ROADS = 4  # of the routes that come by the ramp
_MAX_WAIT_S = 20.0  # after the warm-up, in which a vehicle may become the ego
_EGO_CANDIDATES = 3  # nearest vehicles, among which the ego is drawn
_MAX_EGO_LENGTH_M = 5.6
_GOAL_M = 1.0  # to the end of the way
STANDING = 0.05  # m/s: nuPlan's threshold
_SAME_DIRECTION_COSINE = 0.5


@dataclass(frozen=True, eq=False)
class Way:
    """The way of the ego; right-handed frame, z up."""

    s: Floats  # [n] m along it
    xy: Floats  # [n, 2]
    heading: Floats  # [n] rad, without jumps
    limit: Floats  # [n] m/s
    lane: Ints  # [n] numbers of the lanes

    def at(self, s: Floats) -> tuple[Floats, Floats]:
        """Return places ``[..., 2]`` and headings ``[...]`` at ``s`` m."""
        x = np.interp(s, self.s, self.xy[:, 0])
        y = np.interp(s, self.s, self.xy[:, 1])
        return np.stack([x, y], axis=-1), np.interp(s, self.s, self.heading)

    def along(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return stations of places [n], how far left of the way, and its headings.

        In m and rad. Places beyond `REACH_M` are inf m aside.
        """
        point = self.nearest_points(x, y)
        heading = self.heading[point]
        away_x = x - self.xy[point, 0]
        away_y = y - self.xy[point, 1]
        cos = np.cos(heading)
        sin = np.sin(heading)
        aside_m = np.where(point >= 0, away_y * cos - away_x * sin, np.inf)
        return self.s[point] + away_x * cos + away_y * sin, aside_m, heading

    def nearest_points(self, x: Floats, y: Floats) -> Ints:
        """Return indices of the points next to places [n], -1 beyond `REACH_M`.

        Places outside the grid count as in its outermost cells, which are beyond reach.
        """
        corner, grid = self._station_grid
        cells = []
        for value, start_m, count in zip((x, y), corner, grid.shape, strict=True):
            cell = np.fmin(np.fmax((value - start_m) / _CELL_M, 0), count - 1)
            cells.append(cell.astype(np.int64))
        return np.asarray(grid[cells[0], cells[1]])

    @cached_property
    def _station_grid(self) -> tuple[Floats, Ints]:
        """Lower corner [2] of a grid around the way, and its cells.

        A cell holds the index of the point next to its middle, -1 beyond `REACH_M`.
        """
        corner = self.xy.min(axis=0) - REACH_M - _CELL_M
        extent = self.xy.max(axis=0) + REACH_M - corner
        shape = np.ceil(extent / _CELL_M).astype(np.int64) + 1
        within_reach = np.zeros(shape, dtype=bool)
        reach_cells = round(REACH_M / _CELL_M)
        # every other point: they are closer together than cells
        for x, y in ((self.xy[::2] - corner) / _CELL_M).astype(np.int64).tolist():
            columns = slice(max(x - reach_cells, 0), x + reach_cells + 1)
            rows = slice(max(y - reach_cells, 0), y + reach_cells + 1)
            within_reach[columns, rows] = True
        grid = np.full(within_reach.shape, -1)
        centers = corner + (np.argwhere(within_reach) + 0.5) * _CELL_M
        grid[within_reach] = KDTree(self.xy).query(centers)[1]
        return corner, grid


@dataclass(frozen=True)
class Collision:
    """The first contact of the ego."""

    class_id: int  # index into `world.CLASSES`
    number: int  # number of the road user
    # the ego moved, and was not hit from behind (docs/definitions/driving.md)
    at_fault: bool


class _Ego(Driver):
    """A vehicle that follows its way exactly, at the acceleration of its planner."""

    def follow(self, way: Way, s: float) -> None:
        """Drive along the way from ``s`` m on."""
        self.way = way
        self.s = s
        self.planned_acceleration = 0.0  # m/s2
        self._place()

    def drive(self) -> tuple[float, ...]:
        """Move along the way by a step, without the driver model.

        Returns values as `Driver.drive`.
        """
        step_s = 1.0 / RATE
        speed_mps = float(self.speed)
        acceleration = max(self.planned_acceleration, -speed_mps / step_s)
        self.s = min(self.s + speed_mps * step_s, float(self.way.s[-1]))
        self._place()
        return (
            *self.position,
            self.heading,
            speed_mps + acceleration * step_s,
            acceleration,
        )

    def _place(self) -> None:
        (x, y), heading = self.way.at(np.asarray(self.s))
        self.position = (float(x), -float(y))
        self.heading = -float(heading)
        point = self.way.s.searchsorted(self.s, "right") - 1
        self.lane_number = int(self.way.lane[point])


class DrivenTraffic:
    """Traffic of a seed whose ego is driven, at `RATE` steps per second.

    The ego is a car that comes to the junction, or along the ramp, when the recording
    begins; it takes the rarest way from there, such as a left turn. Equal accelerations
    give the same bits. Raises DataError if no attempt has an ego.
    """

    def __init__(self, traffic: Traffic, seed: int) -> None:
        warmed_up = _warmed_up(traffic, seed)
        attempt, ego = warmed_up
        # parts that never change are shared: deepcopy takes them from its memo
        memo = {id(part): part for part in (*attempt.shared, ego.way)}
        self._attempt, self.ego = deepcopy(warmed_up, memo)
        self.lanes = attempt.lanes
        self._recording = Recording(RATE)
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
        return bool(self.ego.s >= self.way.s[-1] - _GOAL_M)

    @property
    def over(self) -> bool:
        """True after a collision, or at the goal."""
        return self.collision is not None or self.at_goal

    def step(self, acceleration: float) -> None:
        """Drive a step at ``acceleration`` m/s2 and record the frame.

        It brakes by at most `simulate.MAX_BRAKING_MPS2`.
        """
        self.ego.planned_acceleration = max(float(acceleration), -MAX_BRAKING_MPS2)
        vehicles = self._attempt.vehicles
        self._attempt.step(self._vehicle_boxes)
        if self.ego not in vehicles:  # at the end of its route it would leave
            vehicles.append(self.ego)
        self._record()

    def world(self, last_only: bool = False, frames: int | None = None) -> World:
        """Return the frames so far.

        ``frames``: only as many; ``last_only``: only the last one. Objects keep their
        numbers.
        """
        part = slice(-1, None) if last_only else slice(frames)
        return self._recording.seen_from(
            self.ego.number, self.lanes, part, renumbered=False
        )

    def _record(self) -> None:
        """Record the present frame, and the first collision."""
        boxes = self._attempt.boxes()
        self._vehicle_boxes = boxes[0]
        self._attempt.record(self._recording, boxes)
        if self.collision is not None:
            return
        box = np.concatenate(boxes)
        ego_row = self._attempt.vehicles.index(self.ego)
        ego_box = box[ego_row]
        reach_m = np.hypot(box[:, 4], box[:, 5]) / 2
        distance_m = np.hypot(*(box[:, :2] - ego_box[:2]).T)
        rows = np.flatnonzero(distance_m < reach_m + reach_m[ego_row])
        rows = rows[rows != ego_row]
        meets = boxes_meet(box[rows], np.tile(ego_box, (len(rows), 1)))
        hits = rows[meets].tolist()
        if hits:
            speed_mps = float(self.ego.speed)
            faults = [row for row in hits if is_at_fault(ego_box, speed_mps, box[row])]
            # of contacts in the same step, one at fault counts
            first_hit = faults[0] if faults else hits[0]
            class_id, number = self._recording.identity(first_hit)
            self.collision = Collision(class_id, number, bool(faults))


@lru_cache(maxsize=256)  # of 50 kB: more than the scenes of a split
def _warmed_up(traffic: Traffic, seed: int) -> tuple[Attempt, _Ego]:
    """Return traffic at the first frame of a drive, and its ego, to be copied.

    Agents drive in the same scenes, one after the other.
    """
    for number in range(ATTEMPTS):
        attempt = Attempt(traffic, seed, number)
        rng = np.random.default_rng([seed, number, RANDOM_KINDS])
        ego = _ego_after_warm_up(attempt, rng)
        if ego is not None:
            if attempt.rules is not None:
                attempt.rules.driven = ego.number
            return attempt, ego
    raise DataError(
        f"{traffic.scenario}, seed {seed}:"
        f" no vehicle can be the ego in {ATTEMPTS} attempts"
    )


def _ego_after_warm_up(attempt: Attempt, rng: np.random.Generator) -> _Ego | None:
    """Simulate the warm-up, and on until a vehicle can be the ego.

    None after a crash, or if `_MAX_WAIT_S` pass without such a vehicle.
    """
    for step in range(round((WARM_UP + _MAX_WAIT_S) * RATE)):
        boxes = attempt.boxes()
        if attempt.has_crash(boxes):
            return None
        if step >= WARM_UP * RATE:
            ego = _choose_ego(attempt, rng)
            if ego is not None:
                return ego
        attempt.step(boxes[0])
    return None


def _choose_ego(attempt: Attempt, rng: np.random.Generator) -> _Ego | None:
    """Choose a car that is about to meet other road users, and make it the ego.

    None if there is no such car.
    """
    routes = attempt.map.routes
    candidates = _candidates(attempt)
    if not candidates:
        return None
    draw = int(rng.integers(min(_EGO_CANDIDATES, len(candidates))))
    _, index, station_m = sorted(candidates)[draw]
    driver = attempt.vehicles[index]
    # the rarest way: left turns and merges meet more road users than the way straight
    # on, which most drivers take
    first_road = routes[driver.route].roads[0]
    same_start = [r for r, route in enumerate(routes) if route.roads[0] == first_road]
    route = min(same_start, key=lambda r: routes[r].weight)
    ego = _Ego(
        driver.position, driver.heading, driver.speed, driver.traits, driver.number
    )
    ego.route = route
    attempt.vehicles[index] = ego
    ego.follow(way_of(attempt.map, attempt.routes, route), station_m)
    return ego


def _candidates(attempt: Attempt) -> list[tuple[float, int, float]]:
    """Return cars that are about to meet the others.

    Each has the metres to the meeting place, its index among the vehicles, and its
    station on its route, m.
    """
    regulated = attempt.map.regulated
    low_m, high_m = _JUNCTION_DISTANCE_M if regulated else _RAMP_DISTANCE_M
    candidates = []
    for index, driver in enumerate(attempt.vehicles):
        traits = driver.traits
        is_car = traits.class_id == CLASSES.index("car")
        on_ramp = len(attempt.map.routes[driver.route].roads) >= _RAMP_ROADS
        fits = is_car and traits.length <= _MAX_EGO_LENGTH_M
        if not (fits and (regulated or on_ramp)):
            continue
        lane = attempt.map.geometry.lanes[driver.lane_number]
        station_m = float(attempt.routes.start[driver.route, driver.lane_number])
        station_m += float(lane.local_coordinates(driver.position)[0])
        meeting_m = meeting_place(attempt, driver.route)
        distance_m = meeting_m - station_m - traits.length / 2
        if low_m < distance_m < high_m:
            candidates.append((distance_m, index, station_m))
    return candidates


def meeting_place(attempt: Attempt, route: int) -> float:
    """Return metres along a route to where it meets others.

    That is the line to wait at, or the end of a ramp.
    """
    if attempt.rules is not None:
        return attempt.rules.passages[route].line
    roads = attempt.map.routes[route].roads
    # the ramp ends where the last road but one begins
    return float(attempt.routes.start[route, roads[-2][-1]])


def way_of(road_map: RoadMap, routes: RouteTable, route: int) -> Way:
    """Return the way along the middle of the lanes.

    ``route``: index of the route. The way has points every 0.5 m. Where a lane ends,
    the way changes to the one that goes on, between 15 and 75 m after the start of the
    road.
    """
    geometry = road_map.geometry
    roads = road_map.routes[route].roads
    following = routes.following[route]
    parts = []
    lane = roads[0][-1]
    for index, road in enumerate(roads):
        if index > 0:
            lane = int(following[lane])
        target = lane
        if index < len(roads) - 1 and following[lane] == NO_LANE:
            target = next(k for k in reversed(road) if following[k] != NO_LANE)
        stations = np.arange(0.0, geometry.length[lane], _POINT_STEP_M)
        change_share = np.zeros(len(stations))
        if target != lane:
            share = (stations - _CHANGE_START_M) / (_CHANGE_END_M - _CHANGE_START_M)
            share = np.clip(share, 0.0, 1.0)
            change_share = share * share * (3.0 - 2.0 * share)  # smooth at both ends
        start_xy = lane_points(geometry.lanes[lane], stations)
        target_xy = lane_points(geometry.lanes[target], stations)
        xy = start_xy + change_share[:, None] * (target_xy - start_xy)
        lane_number = np.where(change_share > 0.5, target, lane)
        limit_mps = np.full(len(stations), geometry.limit[lane])
        along = routes.start[route, lane] + stations
        parts.append((along, xy * [1.0, -1.0], limit_mps, lane_number))  # y up
        lane = target
    s, xy, limit_mps, lane_number = map(np.concatenate, zip(*parts, strict=True))
    step = np.gradient(xy, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    return Way(s, xy, heading, limit_mps, lane_number)


def is_at_fault(ego: Floats, speed_mps: float, other_box: Floats) -> bool:
    """Return True if the ego is at fault for a contact.

    An ego with ``speed_mps`` is, unless it stood or was hit from behind. ``ego`` and
    ``other_box``: boxes [7].
    """
    return speed_mps > STANDING and not hit_from_behind(ego, other_box)


def hit_from_behind(ego: Floats, other_box: Floats) -> bool:
    """Return True if ``other_box`` [7] touches the rear of the ego alone.

    Both have about the same heading, and the other box ends behind the ego's nose.
    """
    ahead_m = (other_box[:2] - ego[:2]) @ unit_vectors(ego[3])
    turn_rad = other_box[3] - ego[3]
    half_extent_m = (
        abs(np.cos(turn_rad)) * other_box[4] + abs(np.sin(turn_rad)) * other_box[5]
    ) / 2
    touches_rear = ahead_m < 0 and ahead_m + half_extent_m < ego[4] / 2
    return bool(touches_rear and np.cos(turn_rad) > _SAME_DIRECTION_COSINE)
