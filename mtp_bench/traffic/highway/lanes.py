"""Lanes of a road network and the routes through them, and pieces of a road map.

The geometry of all lanes is computed at once. The frame is highway-env's (y down).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core import Bools, Floats, Ints, Lane, wrap_angle
from .library import CircularLane, SineLane, StraightLane

LaneIndex = tuple[str, str, int]

NO_LANE = -1
LOOKAHEAD = 5  # lanes of a driver's path, with the present one
# largest distance of the end of a lane from the start of the one that continues it
_JOINT_M = 0.5
_POINT_STEP_M = 2.0  # between two points of a polyline


class LaneGeometry:
    """Lanes of a highway-env ``RoadNetwork``, numbered in the order of its graph.

    The frame is highway-env's: y points down, headings turn clockwise, and the lateral
    coordinate grows to the right.
    """

    def __init__(self, network: Any) -> None:
        lanes: dict[LaneIndex, Any] = network.lanes_dict()
        self.network = network
        self.index = tuple(lanes)
        self.lanes = tuple(lanes.values())
        self.number = {index: k for k, index in enumerate(self.index)}
        self.length = np.array([float(lane.length) for lane in self.lanes])
        self.limit = np.array([float(lane.speed_limit) for lane in self.lanes])
        self.radius = np.full(len(self), np.inf)
        # +1 to the right, -1 to the left, 0 straight on
        self.turn = np.zeros(len(self))
        # rad, directions of lines and first phases of arcs
        self._angle = np.zeros(len(self))
        # middles of arcs and starts of lines, and directions of lines
        self._origin = np.zeros((len(self), 2))
        self._direction = np.zeros((len(self), 2))
        self._wave = np.zeros((len(self), 3))  # amplitude, pulsation, phase
        for k, lane in enumerate(self.lanes):
            if isinstance(lane, CircularLane):
                self.radius[k] = lane.radius
                self.turn[k] = lane.direction
                self._angle[k] = lane.start_phase
                self._origin[k] = lane.center
            elif isinstance(lane, StraightLane):
                self._origin[k] = lane.start
                self._direction[k] = lane.direction
                self._angle[k] = lane.heading
            if isinstance(lane, SineLane):
                self._wave[k] = (lane.amplitude, lane.pulsation, lane.phase)
        # change of heading per metre; waves count as straight
        self.curvature = self.turn / self.radius
        self._arcs = np.flatnonzero(self.turn)
        self._lines = np.flatnonzero(self.turn == 0)
        self._has_waves = bool(self._wave.any())

    def __len__(self) -> int:
        return len(self.lanes)

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Return coordinates [L, P] of points [2, P] along and across all lanes."""
        along, across = np.empty((2, len(self), points.shape[1]))
        lines = self._lines
        x, y = self._offsets(points, lines)
        direction_x, direction_y = self._direction[lines].T[:, :, None]
        along_m = x * direction_x + y * direction_y
        across_m = y * direction_x - x * direction_y
        if self._has_waves:
            amplitude, pulsation, phase = self._wave[lines].T[:, :, None]
            across_m -= amplitude * np.sin(pulsation * along_m + phase)
        along[lines] = along_m
        across[lines] = across_m
        arcs = self._arcs
        x, y = self._offsets(points, arcs)
        radius = self.radius[arcs, None]
        turn_sign = self.turn[arcs, None]
        angle = wrap_angle(np.arctan2(y, x) - self._angle[arcs, None])
        along[arcs] = turn_sign * angle * radius
        across[arcs] = turn_sign * (radius - np.hypot(x, y))
        return along, across

    def _offsets(self, points: Floats, lanes: Ints) -> Floats:
        """Return offsets [2, n, P] from the origins of lanes."""
        return np.asarray(points[:, None] - self._origin[lanes].T[:, :, None])

    def heading(self, lane: Ints, along_m: Floats) -> Floats:
        """Return the direction of travel [n] at coordinates [n] along lanes [n]."""
        amplitude, pulsation, phase = self._wave[lane].T
        slope = amplitude * pulsation * np.cos(pulsation * along_m + phase)
        tangent = self._angle[lane] + np.arctan(slope)  # of lines
        turned = self.turn[lane] * (along_m / self.radius[lane] + np.pi / 2)
        return np.asarray(tangent + turned)


def lane_map(
    network: dict[LaneIndex, Any], max_gap_m: float = _JOINT_M
) -> tuple[Lane, ...]:
    """Return all lanes, right-handed with z up.

    Centres and borders have points at most every 2 m. If no lane joins the end of a
    lane, the nearest lane of the next road within ``max_gap_m`` that does not lead back
    continues it.
    """
    indices = tuple(network)
    lanes = tuple(network.values())
    centers = [_polyline(lane, lateral=0.0) for lane in lanes]
    result = []
    for k, lane in enumerate(lanes):
        half_width_m = float(lane.width_at(0.0)) / 2
        next_road = [j for j in range(len(lanes)) if indices[j][0] == indices[k][1]]
        result.append(
            Lane(
                centers[k],
                _polyline(lane, -half_width_m),
                _polyline(lane, half_width_m),
                _following(centers, k, next_road, max_gap_m),
            )
        )
    return tuple(result)


def _following(
    centers: list[Floats], k: int, next_road: list[int], max_gap_m: float
) -> tuple[int, ...]:
    """Return the lanes of the next road that continue lane k."""
    end_point = centers[k][-1]
    end_step = end_point - centers[k][-2]
    gap_m = {j: float(np.linalg.norm(centers[j][0] - end_point)) for j in next_road}
    joined = tuple(j for j in next_road if gap_m[j] < _JOINT_M)
    if joined:
        return joined
    onward = [j for j in next_road if end_step @ (centers[j][1] - centers[j][0]) > 0]
    nearest = sorted(onward, key=gap_m.__getitem__)[:1]
    return tuple(j for j in nearest if gap_m[j] < max_gap_m)


def _polyline(lane: Any, lateral: float) -> Floats:
    """Return points [n, 2] from the lane's start to its end.

    They are ``lateral`` m to the right of its middle.
    """
    length_m = float(lane.length)
    point_count = max(math.ceil(length_m / _POINT_STEP_M), 1) + 1
    points = lane_points(lane, np.linspace(0.0, length_m, point_count), lateral)
    points[:, 1] *= -1.0
    return points + 0.0


def lane_points(lane: Any, stations: Floats, lateral: float = 0.0) -> Floats:
    """Return points [n, 2] of a lane, in highway-env's frame."""
    points = [lane.position(float(station), lateral) for station in stations]
    return np.array(points, dtype=np.float64)


@dataclass(frozen=True)
class Route:
    """A way from an entry to an exit.

    ``roads``: numbers of the lanes that can be used on each of its roads.
    """

    roads: tuple[tuple[int, ...], ...]
    weight: float = 1.0  # frequency
    heavy: bool = True  # long vehicles can take it
    otherwise: int = NO_LANE  # route after a missed exit


@dataclass(frozen=True, eq=False)
class RouteTable:
    """Facts about every lane on every route: arrays ``[routes, lanes, ...]``.

    `NO_LANE` stands for a missing lane.
    """

    following: Ints  # the next lane
    left_lane: Ints
    right_lane: Ints
    # lane changes needed to stay on the route; inf: the lane is not part of it
    changes: Floats
    # m from the lane's start to the place where a lane change must be done; inf: none
    room: Floats
    start: Floats  # m from the start of the route
    on_last_road: Bools  # the lane belongs to the last road of the route
    path: Ints  # [routes, lanes, LOOKAHEAD] the lanes ahead, the lane itself first
    path_start: Floats  # [routes, lanes, LOOKAHEAD] m from the lane's start to theirs


def route_table(routes: tuple[Route, ...], geometry: LaneGeometry) -> RouteTable:
    """Return the table of ``routes`` through the lanes of ``geometry``."""
    shape = (len(routes), len(geometry))
    following, left_lane, right_lane = np.full((3, *shape), NO_LANE)
    last_road = np.zeros(shape, dtype=bool)
    start = np.zeros(shape)
    starts = np.array([lane.position(0.0, 0.0) for lane in geometry.lanes])
    ends = np.array([lane.position(lane.length, 0.0) for lane in geometry.lanes])
    for route_index, route in enumerate(routes):
        last_road[route_index, list(route.roads[-1])] = True
        for road_lanes in route.roads:
            left_lane[route_index, list(road_lanes[1:])] = road_lanes[:-1]
            right_lane[route_index, list(road_lanes[:-1])] = road_lanes[1:]
        for k, road_lanes in enumerate(route.roads[:-1]):
            for lane in road_lanes:
                # of several lanes that join, the first one is kept
                for next_lane in reversed(route.roads[k + 1]):
                    start[route_index, next_lane] = (
                        start[route_index, lane] + geometry.length[lane]
                    )
                    if np.linalg.norm(starts[next_lane] - ends[lane]) < _JOINT_M:
                        following[route_index, lane] = next_lane
    changes, room = _needed_changes(routes, geometry, following)
    path, path_start = _paths(following, geometry.length)
    return RouteTable(
        following,
        left_lane,
        right_lane,
        changes,
        room,
        start,
        last_road,
        path,
        path_start,
    )


def _needed_changes(
    routes: tuple[Route, ...], geometry: LaneGeometry, following: Ints
) -> tuple[Floats, Floats]:
    """Return the needed lane changes and the room for them, [routes, lanes].

    The room is in metres, until the first of them must be done.
    """
    changes = np.full(following.shape, np.inf)
    room = np.full(following.shape, np.inf)
    for route_index, route in enumerate(routes):
        changes[route_index, list(route.roads[-1])] = 0
        for road_lanes in reversed(route.roads):
            for lane in road_lanes:
                next_lane = following[route_index, lane]
                if next_lane != NO_LANE:
                    changes[route_index, lane] = changes[route_index, next_lane]
                    room[route_index, lane] = (
                        geometry.length[lane] + room[route_index, next_lane]
                    )
                elif road_lanes != route.roads[-1]:
                    room[route_index, lane] = geometry.length[lane]
            numbers = list(road_lanes)
            for _ in numbers:  # spreads from lane to lane
                sides = np.pad(changes[route_index, numbers], 1, constant_values=np.inf)
                by_neighbour = np.minimum(sides[:-2], sides[2:]) + 1
                changes[route_index, numbers] = np.minimum(
                    changes[route_index, numbers], by_neighbour
                )
    return changes, room


def _paths(following: Ints, length_m: Floats) -> tuple[Ints, Floats]:
    """Return the lanes ahead of each, and metres to them."""
    path = np.full((*following.shape, LOOKAHEAD), NO_LANE)
    start = np.zeros((*following.shape, LOOKAHEAD))
    path[..., 0] = np.arange(following.shape[1])
    for k in range(1, LOOKAHEAD):
        lane = path[..., k - 1]
        goes_on = lane != NO_LANE  # other values below are replaced
        next_lane = np.take_along_axis(following, lane, axis=1)
        path[..., k] = np.where(goes_on, next_lane, NO_LANE)
        start[..., k] = np.where(goes_on, start[..., k - 1] + length_m[lane], 0.0)
    return path, start


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing over an arm.

    Its axis runs from ``origin`` in ``direction`` over ``span`` metres of road.
    """

    origin: tuple[float, float]
    direction: tuple[float, float]
    span: float
    width: float


@dataclass(frozen=True)
class Pavement:
    """Pavement beside two roads that cross at (0, 0) along the axes.

    The kerbs bend around the corners.
    """

    corner: float  # m, the middle of a kerb's bend is at (+-corner, +-corner)
    radius: float  # m, of the bend

    @property
    def kerb(self) -> float:
        """Distance in m from the middle of a road to its straight kerbs."""
        return self.corner - self.radius


@dataclass(frozen=True)
class Kerb:
    """A straight kerb where cars park.

    It is to the right of the way from ``start`` in ``direction``.
    """

    start: tuple[float, float]
    direction: tuple[float, float]
    length: float


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A road network with its routes."""

    geometry: LaneGeometry
    routes: tuple[Route, ...]
    sensor: tuple[float, float, float]  # x, y, z of a roadside sensor
    regulated: bool  # vehicles give way by conflicts of routes; else they overtake
    # False: vehicles may also go before one that is far away
    first_in_first_out: bool = True
    crossings: tuple[Crossing, ...] = ()
    pavement: Pavement | None = None
    kerbs: tuple[Kerb, ...] = ()
