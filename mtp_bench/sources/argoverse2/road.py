"""Lanes in the map of a log, with middle lines and successors.

The middle line is made as the official reader makes it: ten points of each border,
evenly spaced along its length in three dimensions, and the middles of the pairs. Lanes
of bicycles are left out.
"""

from dataclasses import replace
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Lane, Scene
from ..base import DataRoot, link_lanes
from ..text import Number, read_json
from .feather import Sweeps
from .layout import log_folder

CENTER_POINTS = 10  # of a middle line


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
    """Return the lanes of a log in the frame of its scene.

    None without a map. Raises DataError for a wrong map.
    """
    folder = log_folder(card, data, scene.name)
    paths = sorted(folder.glob("map/log_map_archive_*.json"))
    if not paths:
        return ()
    segments = read_json(paths[0], _Map).lane_segments.values()
    records = [record for record in segments if record.lane_type != "BIKE"]
    successors = {record.id: record.successors for record in records}
    if len(successors) < len(records):
        raise DataError(
            f"{paths[0]}: two lanes have the same id, expected one of its own for each"
        )
    origin = Sweeps.read(folder, 1).origin
    lanes: dict[int, Lane] = {}
    for record in records:
        left_border = _points(record.left_lane_boundary) - origin
        right_border = _points(record.right_lane_boundary) - origin
        lane = lane_between(left_border, right_border)
        lanes[record.id] = replace(lane, junction=record.is_intersection)
    return link_lanes(lanes, successors)


def _points(border: list[_Point]) -> Floats:
    return np.array([(point.x, point.y, point.z) for point in border])


def lane_between(left_border: Floats, right_border: Floats) -> Lane:
    """Return the lane between a left and a right border [n, 3]."""
    # else the lane turns about one point
    if min(len(left_border), len(right_border)) > 1:
        left_border = even(left_border, CENTER_POINTS)
        right_border = even(right_border, CENTER_POINTS)
    edges = np.broadcast_arrays(left_border[:, :2], right_border[:, :2])
    return Lane((edges[0] + edges[1]) / 2, edges[0], edges[1])


def even(line: Floats, count: int) -> Floats:
    """Return points [count, 3] of a polyline [n, 3], evenly spaced along it."""
    steps_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    station_m = np.append(0.0, np.cumsum(steps_m))
    even_station = np.linspace(0.0, station_m[-1], count)
    even_axes = [np.interp(even_station, station_m, axis) for axis in line.T]
    return np.stack(even_axes, axis=1)
