"""Lanes of a road network: their geometry, all at once, and the routes through them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core import Bools, Floats, Ints, Lane
from .library import CircularLane, SineLane, StraightLane

LaneIndex = tuple[str, str, int]

NO_LANE = -1
LOOKAHEAD = 5  # lanes of a driver's path, with the present one
JOINT = 0.5  # m, largest distance of the end of a lane from the start of the one that continues it
_STEP = 2.0  # m between two points of a polyline


class LaneGeometry:
    """Lanes of a highway-env ``RoadNetwork``, numbered in the order of its graph.

    The frame is highway-env's: y points down, headings turn clockwise, and the lateral coordinate grows to the right.
    """

    def __init__(self, network: Any) -> None:
        lanes: dict[LaneIndex, Any] = network.lanes_dict()
        self.index = tuple(lanes)
        self.lanes = tuple(lanes.values())
        self.number = {index: k for k, index in enumerate(self.index)}
        self.length = np.array([float(lane.length) for lane in self.lanes])
        self.limit = np.array([float(lane.speed_limit) for lane in self.lanes])
        self._arc = np.array([isinstance(lane, CircularLane) for lane in self.lanes])
        arcs = [lane for lane in self.lanes if isinstance(lane, CircularLane)]
        self._center = np.array(
            [lane.center for lane in arcs], dtype=np.float64
        ).reshape(-1, 2)
        self.radius = np.full(len(self), np.inf)
        self.turn = np.zeros(
            len(self)
        )  # +1 to the right, -1 to the left, 0 straight on
        self._phase = np.zeros(len(self))
        self.radius[self._arc] = [lane.radius for lane in arcs]
        self.turn[self._arc] = [lane.direction for lane in arcs]
        self.curvature = (
            self.turn / self.radius
        )  # change of heading per metre; waves count as straight
        self._phase[self._arc] = [lane.start_phase for lane in arcs]
        lines = [lane for lane in self.lanes if isinstance(lane, StraightLane)]
        self._start = np.array(
            [lane.start for lane in lines], dtype=np.float64
        ).reshape(-1, 2)
        self._along = np.array(
            [lane.direction for lane in lines], dtype=np.float64
        ).reshape(-1, 2)
        self._heading = np.zeros(len(self))
        self._heading[~self._arc] = [lane.heading for lane in lines]
        self._wave = np.zeros((len(self), 3))  # amplitude, pulsation, phase
        for k, lane in enumerate(self.lanes):
            if isinstance(lane, SineLane):
                self._wave[k] = lane.amplitude, lane.pulsation, lane.phase
        self._waves = bool(self._wave.any())
        self._lines, self._arcs = np.flatnonzero(~self._arc), np.flatnonzero(self._arc)
        self._bends = [
            values[self._arc, None] for values in (self.radius, self.turn, self._phase)
        ]

    def __len__(self) -> int:
        return len(self.lanes)

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Longitudinal and lateral coordinates ``[L, P]`` of points ``[2, P]`` in every lane."""
        along, across = np.empty((2, len(self), points.shape[1]))
        px, py = points
        if len(self._lines):
            x, y = px - self._start[:, :1], py - self._start[:, 1:]
            ux, uy = self._along[:, :1], self._along[:, 1:]
            s, d = x * ux + y * uy, y * ux - x * uy
            if self._waves:
                amplitude, pulsation, phase = (
                    self._wave[self._lines, k, None] for k in range(3)
                )
                d -= amplitude * np.sin(pulsation * s + phase)
            along[self._lines], across[self._lines] = s, d
        if len(self._arcs):
            x, y = px - self._center[:, :1], py - self._center[:, 1:]
            radius, turn, phase = self._bends
            angle = np.remainder(np.arctan2(y, x) - phase + np.pi, 2 * np.pi) - np.pi
            along[self._arcs] = turn * angle * radius
            across[self._arcs] = turn * (radius - np.hypot(x, y))
        return along, across

    def heading(self, lane: Ints, s: Floats) -> Floats:
        """Direction of travel ``[n]`` at longitudinal coordinates ``[n]`` of lanes ``[n]``."""
        line = self._heading[lane]
        if self._waves:
            amplitude, pulsation, phase = self._wave[lane].T
            line = line + np.arctan(
                amplitude * pulsation * np.cos(pulsation * s + phase)
            )
        arc = self._phase[lane] + self.turn[lane] * (s / self.radius[lane] + np.pi / 2)
        return np.where(self._arc[lane], arc, line)


def lane_map(network: dict[LaneIndex, Any], loose: float = JOINT) -> tuple[Lane, ...]:
    """All lanes, right-handed with z up: centres and borders at most every 2 m, and the lanes that continue each.

    ``loose``: metres to the nearest lane of the next road that does not lead back: it continues one that no lane joins.
    """
    index, lanes = tuple(network), tuple(network.values())
    centers = [_polyline(lane, 0.0) for lane in lanes]
    result = []
    for k, lane in enumerate(lanes):
        half = float(lane.width_at(0.0)) / 2
        after = [j for j in range(len(lanes)) if index[j][0] == index[k][1]]
        gap = {j: float(np.linalg.norm(centers[j][0] - centers[k][-1])) for j in after}
        following = tuple(j for j in after if gap[j] < JOINT)
        end = centers[k][-1] - centers[k][-2]
        onward = [
            j
            for j in after
            if gap[j] < loose and end @ (centers[j][1] - centers[j][0]) > 0
        ]  # not the way back
        following = following or tuple(sorted(onward, key=lambda j: gap[j])[:1])
        result.append(
            Lane(centers[k], _polyline(lane, -half), _polyline(lane, half), following)
        )
    return tuple(result)


def _polyline(lane: Any, lateral: float) -> Floats:
    """Points ``[n, 2]`` at a distance to the right of the middle, from the lane's start to its end."""
    stations = np.linspace(
        0.0, float(lane.length), max(math.ceil(float(lane.length) / _STEP), 1) + 1
    )
    points = np.array(
        [lane.position(float(s), lateral) for s in stations], dtype=np.float64
    )
    points[:, 1] *= -1.0
    return points + 0.0


@dataclass(frozen=True)
class Route:
    """A way from an entry to an exit: the numbers of the lanes that can be used on each of its roads."""

    roads: tuple[tuple[int, ...], ...]
    weight: float = 1.0  # frequency
    heavy: bool = True  # long vehicles can take it
    otherwise: int = NO_LANE  # route after a missed exit


@dataclass(frozen=True, eq=False)
class RouteTable:
    """Facts about every lane on every route: arrays ``[routes, lanes, ...]``; `NO_LANE` for a missing lane."""

    following: Ints  # the next lane
    left: Ints
    right: Ints
    changes: Floats  # lane changes needed to stay on the route; inf: the lane is not part of it
    room: Floats  # m from the lane's start to the place where a lane change must be done; inf: none is needed
    start: Floats  # m from the start of the route
    last: Bools  # the lane belongs to the last road of the route
    path: Ints  # [routes, lanes, LOOKAHEAD] the lanes ahead, the lane itself first
    path_start: Floats  # [routes, lanes, LOOKAHEAD] m from the lane's start to theirs


def route_table(routes: tuple[Route, ...], geometry: LaneGeometry) -> RouteTable:
    """Table of ``routes`` through the lanes of ``geometry``."""
    shape = (len(routes), len(geometry))
    following, left, right = (np.full(shape, NO_LANE) for _ in range(3))
    last = np.zeros(shape, dtype=bool)
    start = np.zeros(shape)
    for r, route in enumerate(routes):
        for e, road in enumerate(route.roads):
            for k, lane in enumerate(road):
                left[r, lane] = road[k - 1] if k > 0 else NO_LANE
                right[r, lane] = road[k + 1] if k + 1 < len(road) else NO_LANE
                last[r, lane] = e + 1 == len(route.roads)
                if not last[r, lane]:
                    end = geometry.lanes[lane].position(geometry.length[lane], 0.0)
                    for after in reversed(route.roads[e + 1]):
                        start[r, after] = start[r, lane] + geometry.length[lane]
                        if (
                            np.linalg.norm(
                                geometry.lanes[after].position(0.0, 0.0) - end
                            )
                            < JOINT
                        ):
                            following[r, lane] = after
    changes, room = _needed_changes(routes, geometry, following, left, right)
    path, path_start = _paths(following, geometry.length)
    return RouteTable(
        following, left, right, changes, room, start, last, path, path_start
    )


def _needed_changes(
    routes: tuple[Route, ...],
    geometry: LaneGeometry,
    following: Ints,
    left: Ints,
    right: Ints,
) -> tuple[Floats, Floats]:
    """Needed lane changes, and the metres within which the first of them must be done."""
    changes, room = np.full(following.shape, np.inf), np.full(following.shape, np.inf)
    for r, route in enumerate(routes):
        for e in reversed(range(len(route.roads))):
            road = route.roads[e]
            for lane in road:
                after = following[r, lane]
                if e + 1 == len(route.roads):
                    changes[r, lane] = 0
                elif after == NO_LANE:
                    room[r, lane] = geometry.length[lane]
                else:
                    changes[r, lane], room[r, lane] = (
                        changes[r, after],
                        geometry.length[lane] + room[r, after],
                    )
            for _ in road:
                for lane in road:
                    beside = [
                        side[r, lane]
                        for side in (left, right)
                        if side[r, lane] != NO_LANE
                    ]
                    changes[r, lane] = min(
                        [changes[r, lane], *(changes[r, b] + 1 for b in beside)]
                    )
    return changes, room


def _paths(following: Ints, length: Floats) -> tuple[Ints, Floats]:
    path, start = (
        np.full((*following.shape, LOOKAHEAD), NO_LANE),
        np.zeros((*following.shape, LOOKAHEAD)),
    )
    path[..., 0] = np.arange(following.shape[1])
    for k in range(1, LOOKAHEAD):
        before = path[..., k - 1]
        path[..., k] = np.where(
            before != NO_LANE, np.take_along_axis(following, before, axis=1), NO_LANE
        )
        start[..., k] = np.where(
            before != NO_LANE, start[..., k - 1] + length[before], 0.0
        )
    return path, start
