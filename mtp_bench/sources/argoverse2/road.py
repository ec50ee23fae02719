"""The road of a log, of its own map: lanes with their middle lines and those that continue them.

The middle line is made as the official reader makes it: ten points of each border, evenly spaced along its length in
three dimensions, and the middles of the pairs. Lanes of bicycles are left out.
"""

from dataclasses import replace
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Lane, Scene
from ..base import DataRoot
from ..nuscenes.tables import Number
from ..text import read_json
from .feather import Sweeps
from .layout import log_folder

POINTS = 10  # of a middle line


class _Point(msgspec.Struct, gc=False):
    x: Number
    y: Number
    z: Number


_Border = Annotated[list[_Point], msgspec.Meta(min_length=1)]


class _Lane(msgspec.Struct):
    id: int
    is_intersection: bool
    lane_type: str
    left_lane_boundary: _Border
    right_lane_boundary: _Border
    successors: list[int]


class _Map(msgspec.Struct):
    lane_segments: dict[str, _Lane]


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """The lanes of a log in the frame of its scene; none if the map is not there. Raises DataError for a wrong one."""
    folder = log_folder(card, data, scene.name)
    paths = sorted(folder.glob("map/log_map_archive_*.json"))
    if not paths:
        return ()
    parts = read_json(paths[0], _Map).lane_segments.values()
    lanes, origin = (
        [lane for lane in parts if lane.lane_type != "BIKE"],
        Sweeps.read(folder, 1).origin,
    )
    index = {lane.id: i for i, lane in enumerate(lanes)}
    if len(index) < len(lanes):
        raise DataError(
            f"{paths[0]}: two lanes have the same id, expected one of its own for each"
        )
    return tuple(_lane(lane, index, origin) for lane in lanes)


def _lane(lane: _Lane, index: dict[int, int], origin: Floats) -> Lane:
    left, right = (
        np.array([(point.x, point.y, point.z) for point in border]) - origin
        for border in (lane.left_lane_boundary, lane.right_lane_boundary)
    )
    following = tuple(
        index[after] for after in lane.successors if after in index
    )  # others leave the map
    return replace(
        lane_between(left, right), following=following, junction=lane.is_intersection
    )


def lane_between(*borders: Floats) -> Lane:
    """The lane between a left and a right border [n, 3]."""
    if min(map(len, borders)) > 1:  # else the lane turns about one point
        borders = tuple(even(border, POINTS) for border in borders)
    left, right = np.broadcast_arrays(*(border[:, :2] for border in borders))
    return Lane((left + right) / 2, left, right)


def even(line: Floats, count: int) -> Floats:
    """Points [count, 3] of a polyline [n, 3], evenly spaced along it."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    stations = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(stations, along, axis) for axis in line.T], axis=1)
