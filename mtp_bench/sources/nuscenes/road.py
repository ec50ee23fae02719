"""The road around a scene, of the nuScenes map expansion (v1.3): its lanes, with their middle lines and polygons.

========================= ==================================================================================
``lane``                  a lane of a road, with its polygon
``lane_connector``        a way through a junction; its polygon, if any, is not needed
``arcline_path_3``        the middle line of each of them by its token: parts of three arcs or straights each
``polygon``, ``node``     polygons by the tokens of their nodes, nodes in metres of the global frame
========================= ==================================================================================

A map is read when a scene is drawn, never when a scene is loaded.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, Lane, Scene, starts_of
from ..base import DataRoot, section_of
from ..cache import Arrays, write_arrays
from ..text import read_json
from .decoding import Number, TableRecord, Vector, by_token, find, read_records
from .layout import DATASET, EXPANSION, VERSIONS, NuScenesSource
from .store import CachedFolder

REACH = 100.0  # m from the way of the ego, within which the road is drawn
STEP = 2.0  # m, between points of a middle line, at most
LONGEST = 5e3  # m, part of a middle line
HALF = 1.75, 6.0  # m, from the middle of a lane to its border: without a polygon, and at most
_TURN = {"L": 1.0, "S": 0.0, "R": -1.0}  # sign of the curvature
_Length = Annotated[float, msgspec.Meta(ge=0, le=LONGEST)]


class _Log(TableRecord):
    location: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$")]


class _Scene(TableRecord):
    name: str
    log_token: str


class _LaneRecord(TableRecord):
    polygon_token: str


class _Polygon(TableRecord):
    exterior_node_tokens: list[str]


class _Node(TableRecord):
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
    lane_connector: list[TableRecord] = []
    arcline_path_3: dict[str, list[_Path]] = {}
    polygon: list[_Polygon] = []
    node: list[_Node] = []


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """The lanes near the way of the ego, in the global frame; none if there is no map of its location.

    A map is read once per machine, then kept as arrays. Raises DataError for a map or a table that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not (root / EXPANSION).is_dir():
        return ()
    path = root / EXPANSION / f"{location_of(root / section_of(card, NuScenesSource).version, scene.name)}.json"
    if not path.is_file():
        return ()
    cache = CachedFolder.of(f"map-{path.stem}", {path.name: path}, partial(_fill, path))
    return near(cache.read("lanes"), scene.ego)


def location_of(version: Path, scene: str) -> str:
    """The place where a scene was recorded, such as "boston-seaport", by the tables in the folder ``version``."""
    logs, path = by_token(version / "log.json", _Log), version / "scene.json"
    for record in read_records(path, _Scene):
        if record.name == scene:
            return find(logs, record, "log_token", path).location
    raise DataError(f"{path} has no scene {scene!r}")


def near(arrays: Arrays, ego: Floats) -> tuple[Lane, ...]:
    """The lanes of a location that come within `REACH` of the ego's places [F, 4]."""
    point, start = arrays["point"], arrays["start"]
    center = point[:, 0]
    seen = np.zeros(len(center), dtype=bool)
    for x, y in ego[:, :2]:
        seen |= np.hypot(center[:, 0] - x, center[:, 1] - y) <= REACH
    return tuple(
        Lane(point[first:end, 0], point[first:end, 1], point[first:end, 2], junction=bool(junction))
        for first, end, junction in zip(start[:-1], start[1:], arrays["junction"], strict=True)
        if seen[first:end].any()
    )


def _fill(path: Path, folder: Path) -> None:
    lanes = read_lanes(path)
    points = [np.stack([lane.center, lane.left, lane.right], axis=1) for lane in lanes]
    arrays = {
        "point": np.concatenate(points),  # [P, 3, 2] m, global frame: middle, left, right
        "start": starts_of([len(own) for own in points]),  # [L + 1]
        "junction": np.array([lane.junction for lane in lanes], dtype=bool),  # [L]
    }
    write_arrays(folder / "lanes.npz", arrays)


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
    """Distance of each corner of the polygon along the middle line [m], and to its left [m]; metres."""
    start, way = center[:-1], np.diff(center, axis=0)
    length = np.linalg.norm(way, axis=1)
    gap = ring[:, None] - start  # [m, n - 1, 2]
    share = np.clip((gap * way).sum(axis=2) / length**2, 0.0, 1.0)
    nearest = np.argmin(np.linalg.norm(gap - share[..., None] * way, axis=2), axis=1)
    row = np.arange(len(ring))
    across = (way[nearest, 0] * gap[row, nearest, 1] - way[nearest, 1] * gap[row, nearest, 0]) / length[nearest]
    return place[nearest] + share[row, nearest] * length[nearest], across
