"""Geometry of all lanes of a road network at once, with the coordinates of highway-env's lane classes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from highway_env.road.lane import CircularLane, SineLane, StraightLane

from ...errors import DataError
from ...types import Bools, Floats, Ints, Lane

LaneIndex = tuple[str, str, int]

_STEP = 2.0  # m between two points of a polyline
JOINT = 0.5  # m, the end of a lane and the start of the one that continues it may be this far apart


class LaneGeometry:
    """Lanes of a highway-env ``RoadNetwork``, numbered in the order of its graph.

    The frame is highway-env's: y points down, headings turn clockwise, and the lateral coordinate grows to the right.
    """

    def __init__(self, network: Any) -> None:
        lanes: dict[LaneIndex, Any] = network.lanes_dict()
        self.index: tuple[LaneIndex, ...] = tuple(lanes)
        self.lanes: tuple[Any, ...] = tuple(lanes.values())
        self.number: dict[LaneIndex, int] = {index: k for k, index in enumerate(self.index)}
        self.length: Floats = np.array([float(lane.length) for lane in self.lanes])
        self.limit: Floats = np.array([float(lane.speed_limit) for lane in self.lanes])
        self._arc: Bools = np.array([isinstance(lane, CircularLane) for lane in self.lanes])
        if not all(isinstance(lane, (CircularLane, StraightLane)) for lane in self.lanes):
            kinds = sorted({type(lane).__name__ for lane in self.lanes})
            raise DataError(f"lanes of {kinds}: expected StraightLane, SineLane and CircularLane only")
        self._read_arcs()
        self._read_lines()

    def __len__(self) -> int:
        return len(self.lanes)

    def _read_arcs(self) -> None:
        arcs = [lane for lane in self.lanes if isinstance(lane, CircularLane)]
        self._center: Floats = np.array([lane.center for lane in arcs], dtype=np.float64).reshape(-1, 2)
        self.radius: Floats = np.full(len(self), np.inf)
        self.turn: Floats = np.zeros(len(self))  # +1 to the right, -1 to the left, 0 straight on
        self._phase: Floats = np.zeros(len(self))
        self.radius[self._arc] = [lane.radius for lane in arcs]
        self.turn[self._arc] = [lane.direction for lane in arcs]
        self._phase[self._arc] = [lane.start_phase for lane in arcs]

    def _read_lines(self) -> None:
        lines = [lane for lane in self.lanes if isinstance(lane, StraightLane)]
        self._start: Floats = np.array([lane.start for lane in lines], dtype=np.float64).reshape(-1, 2)
        self._along: Floats = np.array([lane.direction for lane in lines], dtype=np.float64).reshape(-1, 2)
        self._heading: Floats = np.zeros(len(self))
        self._heading[~self._arc] = [lane.heading for lane in lines]
        self._wave: Floats = np.zeros((len(self), 3))  # amplitude, pulsation, phase
        for k, lane in enumerate(self.lanes):
            if isinstance(lane, SineLane):
                self._wave[k] = lane.amplitude, lane.pulsation, lane.phase

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Longitudinal and lateral coordinates ``[L, P]`` of points ``[P, 2]`` in every lane."""
        along, across = np.empty((len(self), len(points))), np.empty((len(self), len(points)))
        line = ~self._arc
        if line.any():
            x, y = points[:, 0] - self._start[:, :1], points[:, 1] - self._start[:, 1:]
            ux, uy = self._along[:, :1], self._along[:, 1:]
            s = x * ux + y * uy
            amplitude, pulsation, phase = (self._wave[line, k, None] for k in range(3))
            along[line] = s
            across[line] = y * ux - x * uy
            if amplitude.any():
                across[line] -= amplitude * np.sin(pulsation * s + phase)
        if self._arc.any():
            x, y = points[:, 0] - self._center[:, :1], points[:, 1] - self._center[:, 1:]
            radius, turn, phase = (a[self._arc, None] for a in (self.radius, self.turn, self._phase))
            angle = np.remainder(np.arctan2(y, x) - phase + np.pi, 2 * np.pi) - np.pi
            along[self._arc] = turn * angle * radius
            across[self._arc] = turn * (radius - np.hypot(x, y))
        return along, across

    def heading(self, lane: Ints, s: Floats) -> Floats:
        """Direction of travel ``[n]`` at longitudinal coordinates ``[n]`` of lanes ``[n]``."""
        amplitude, pulsation, phase = self._wave[lane].T
        line = self._heading[lane] + np.arctan(amplitude * pulsation * np.cos(pulsation * s + phase))
        arc = self._phase[lane] + self.turn[lane] * (s / self.radius[lane] + np.pi / 2)
        return np.where(self._arc[lane], arc, line)

    def curvature(self, lane: Ints) -> Floats:
        """Change of heading per metre ``[n]`` of lanes ``[n]``; waves count as straight."""
        return self.turn[lane] / self.radius[lane]


def lane_map(geometry: LaneGeometry) -> tuple[Lane, ...]:
    """All lanes, z up and right-handed: centre and borders every 2 m or less, and which lanes continue which."""
    lanes, index = geometry.lanes, geometry.index
    centers = [_polyline(lane, 0.0) for lane in lanes]
    result = []
    for k, lane in enumerate(lanes):
        half = float(lane.width_at(0.0)) / 2
        following = tuple(
            j
            for j in range(len(lanes))
            if index[j][0] == index[k][1] and np.linalg.norm(centers[j][0] - centers[k][-1]) < JOINT
        )
        result.append(Lane(centers[k], _polyline(lane, -half), _polyline(lane, half), following))
    return tuple(result)


def _polyline(lane: Any, lateral: float) -> Floats:
    """Points ``[n, 2]`` at a distance to the right of the middle, from the lane's start to its end."""
    at = np.linspace(0.0, float(lane.length), max(math.ceil(float(lane.length) / _STEP), 1) + 1)
    points: Floats = np.array([lane.position(float(s), lateral) for s in at], dtype=np.float64)
    points[:, 1] *= -1.0
    return points + 0.0
