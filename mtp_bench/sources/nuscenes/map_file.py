"""A file of the nuScenes map expansion (v1.3), of which the lanes are read: their middle lines and their polygons.

========================= ==================================================================================
``lane``                  a lane of a road, with its polygon
``lane_connector``        a way through a junction; its polygon, if any, is not needed
``arcline_path_3``        the middle line of each of them by its token: parts of three arcs or straights each
``polygon``, ``node``     polygons by the tokens of their nodes, nodes in metres of the global frame
========================= ==================================================================================
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...errors import DataError
from ...types import Floats, Lane
from ..text import read_json
from .decoding import Number, Record, Vector, find

STEP = 2.0  # m, between points of a middle line, at most
LONGEST = 5e3  # m, part of a middle line
HALF = 1.75, 6.0  # m, from the middle of a lane to its border: without a polygon, and at most
_TURN = {"L": 1.0, "S": 0.0, "R": -1.0}  # sign of the curvature
_Length = Annotated[float, msgspec.Meta(ge=0, le=LONGEST)]


class _LaneRecord(Record):
    polygon_token: str


class _Polygon(Record):
    exterior_node_tokens: list[str]


class _Node(Record):
    x: Number
    y: Number


class _Path(msgspec.Struct):
    """Up to three arcs or straights that go on from each other."""

    start_pose: Vector  # x y heading
    shape: Annotated[str, msgspec.Meta(pattern="^[LSR]{3}$")]
    segment_length: tuple[_Length, _Length, _Length]
    radius: Annotated[float, msgspec.Meta(ge=0)]


class _Map(msgspec.Struct):
    lane: list[_LaneRecord] = []
    lane_connector: list[Record] = []
    arcline_path_3: dict[str, list[_Path]] = {}
    polygon: list[_Polygon] = []
    node: list[_Node] = []


def read_lanes(path: Path) -> tuple[Lane, ...]:
    """The lanes of a location, in the global frame; DataError names the file and token that is wrong."""
    layers = read_json(path, _Map)
    polygons = {polygon.token: polygon for polygon in layers.polygon}
    nodes = {node.token: (node.x, node.y) for node in layers.node}
    lanes = []
    for record in (*layers.lane, *layers.lane_connector):
        center = _center(layers.arcline_path_3.get(record.token, []))
        if len(center) < 2:
            continue  # a lane without a middle line
        ring: list[tuple[float, float]] = []
        if isinstance(record, _LaneRecord):
            polygon = find(polygons, record, "polygon_token", path)
            missing = set(polygon.exterior_node_tokens) - nodes.keys()
            if missing:
                raise DataError(f"{path}: layer 'node' has no record {min(missing)!r}, which a polygon names")
            ring = [nodes[token] for token in polygon.exterior_node_tokens]
        left, right = borders(center, np.array(ring).reshape(-1, 2))
        lanes.append(Lane(center, left, right, junction=not isinstance(record, _LaneRecord)))
    if not lanes:
        raise DataError(f"{path} has no lane with a middle line, expected a file of the map expansion")
    return tuple(lanes)


def _center(parts: list[_Path]) -> Floats:
    """Points [n, 2] of a middle line."""
    line = np.concatenate([np.zeros((0, 2)), *(_points(part) for part in parts)])
    moves = np.linalg.norm(np.diff(line, axis=0, prepend=np.inf), axis=1) > 1e-3  # parts meet in a point
    return np.asarray(line[moves])


def _points(part: _Path) -> Floats:
    """Points [n, 2] of one part of a middle line."""
    x, y, heading = part.start_pose
    points = [np.array([[x, y]])]
    for letter, length in zip(part.shape, part.segment_length, strict=True):
        curvature = _TURN[letter] / part.radius if part.radius else 0.0
        along = np.linspace(0.0, length, max(1, math.ceil(length / STEP)) + 1)[1:]
        turned = heading + curvature * along
        chord = along * np.sinc(curvature * along / (2 * np.pi))
        way = (heading + turned) / 2  # of a chord of the arc
        points.append(points[-1][-1] + chord[:, None] * np.column_stack([np.cos(way), np.sin(way)]))
        heading = float(turned[-1])
    return np.concatenate(points)


def borders(center: Floats, ring: Floats) -> tuple[Floats, Floats]:
    """The left and the right border of a lane [n, 2] each, point by point beside its middle line ``center`` [n, 2].

    ``ring`` [m, 2]: the polygon around it; it may be empty. Its corners on a side say how far that border is away.
    """
    step = np.gradient(center, axis=0)
    aside = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.maximum(np.linalg.norm(step, axis=1), 1e-9)[:, None]
    place = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(center, axis=0), axis=1))])
    along, offset = _beside(center, place, ring)
    sides = []
    for sign in (1.0, -1.0):
        own = np.flatnonzero(sign * offset > 0.1)
        own = own[np.argsort(along[own], kind="stable")]
        far = np.interp(place, along[own], sign * offset[own]) if len(own) else np.full(len(place), HALF[0])
        sides.append(center + sign * np.minimum(far, HALF[1])[:, None] * aside)
    return sides[0], sides[1]


def _beside(center: Floats, place: Floats, ring: Floats) -> tuple[Floats, Floats]:
    """How far along the middle line each corner of the polygon is [m], and how far to its left [m]; metres."""
    start, way = center[:-1], np.diff(center, axis=0)
    length = np.linalg.norm(way, axis=1)
    gap = ring[:, None] - start  # [m, n - 1, 2]
    share = np.clip((gap * way).sum(axis=2) / length**2, 0.0, 1.0)
    nearest = np.argmin(np.linalg.norm(gap - share[..., None] * way, axis=2), axis=1)
    row = np.arange(len(ring))
    across = (way[nearest, 0] * gap[row, nearest, 1] - way[nearest, 1] * gap[row, nearest, 0]) / length[nearest]
    return place[nearest] + share[row, nearest] * length[nearest], across
