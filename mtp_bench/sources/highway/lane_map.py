"""The lanes of a road map as polylines, in a right-handed frame with z up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...types import Floats, Lane
from .networks import RoadMap

_STEP = 2.0  # m between two points
_JOINT = 0.5  # m


def lane_map(town: RoadMap) -> tuple[Lane, ...]:
    """All lanes with centre and borders every 2 m or less, and which lanes continue which."""
    lanes = town.geometry.lanes
    centers = [_polyline(lane, 0.0) for lane in lanes]
    index = town.geometry.index
    result = []
    for k, lane in enumerate(lanes):
        half = float(lane.width_at(0.0)) / 2
        following = tuple(
            j
            for j in range(len(lanes))
            if index[j][0] == index[k][1] and np.linalg.norm(centers[j][0] - centers[k][-1]) < _JOINT
        )
        result.append(Lane(centers[k], _polyline(lane, -half), _polyline(lane, half), following))
    return tuple(result)


def _polyline(lane: Any, lateral: float) -> Floats:
    """Points ``[n, 2]`` at a distance to the right of the middle, from the lane's start to its end."""
    at = np.linspace(0.0, float(lane.length), max(math.ceil(float(lane.length) / _STEP), 1) + 1)
    points: Floats = np.array([lane.position(float(s), lateral) for s in at], dtype=np.float64)
    points[:, 1] *= -1.0
    return points + 0.0
