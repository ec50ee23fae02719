"""A file of the nuScenes map expansion (v1.3), of which the lanes are read: their middle lines and their polygons.

========================= ==================================================================================
``lane``                  a lane of a road, with its polygon
``lane_connector``        a way through a junction; its polygon, if any, is not needed
``arcline_path_3``        the middle line of each of them by its token: parts of three arcs or straights each
``polygon``, ``node``     polygons by the tokens of their nodes, nodes in metres of the global frame
========================= ==================================================================================

The layers are read one after the other: of a file of many megabytes only what the lanes need is kept.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Floats, Lane
from .fields import LIMIT, extended, named, text
from .json_stream import Read, Record, brief, read_entries, read_list

LAYERS = {"lane": False, "lane_connector": True}  # whether it leads through a junction
PASSES = 5  # how often a file is read, one layer after the other
STEP = 2.0  # m, between points of a middle line, at most
LONGEST = 5e3  # m, part of a middle line
HALF = 1.75, 6.0  # m, from the middle of a lane to its border: without a polygon, and at most
_TURN = {"L": 1.0, "S": 0.0, "R": -1.0}  # sign of the curvature


def read_lanes(path: Path, read: Read) -> tuple[Lane, ...]:
    """The lanes of a location, in the global frame; DataError names the file and token that is wrong."""
    polygon_of, junction = _read_layers(path, read)
    center = _read_centers(path, junction, read)
    rings = _read_rings(path, {polygon_of[lane] for lane in center if lane in polygon_of}, read)
    places = _read_nodes(path, {node for ring in rings.values() for node in ring}, read)
    lanes = []
    for lane, line in center.items():
        nodes = rings.get(polygon_of.get(lane, ""), [])
        left, right = borders(line, np.array([places[node] for node in nodes]).reshape(-1, 2))
        lanes.append(Lane(line, left, right, junction=junction[lane]))
    return tuple(lanes)


def _read_layers(path: Path, read: Read) -> tuple[dict[str, str], dict[str, bool]]:
    """The polygon of each lane of a road, and whether each lane leads through a junction."""
    polygon_of: dict[str, str] = {}
    junction: dict[str, bool] = {}
    for layer, inside in LAYERS.items():
        for record in read_list(path, layer, read):
            token = text(path, record, "token")
            junction[token] = inside
            if layer == "lane":
                polygon_of[token] = text(path, record, "polygon_token")
    if not junction:
        raise DataError(f"{path} has no lanes, expected a file of the map expansion with the layer 'lane'")
    return polygon_of, junction


def _read_centers(path: Path, lanes: Iterable[str], read: Read) -> dict[str, Floats]:
    """Middle lines [n, 2] by lane; a lane without one is left out."""
    wanted, found = set(lanes), dict[str, Floats]()
    for lane, parts in read_entries(path, "arcline_path_3", read):
        if lane in wanted:
            if not isinstance(parts, list):
                raise DataError(f"{path}, lane {lane!r}: got {brief(parts)}, expected parts of its middle line")
            line = np.concatenate([np.zeros((0, 2)), *(_arcs(path, lane, part) for part in parts)])
            moves = np.linalg.norm(np.diff(line, axis=0, prepend=np.inf), axis=1) > 1e-3  # parts meet in a point
            if moves.sum() > 1:
                found[lane] = line[moves]
    if not found:
        raise DataError(f"{path}: 'arcline_path_3' has no middle line of a lane")
    return found


def _arcs(path: Path, lane: str, part: Record) -> Floats:
    """Points [n, 2] of one part of a middle line: up to three arcs or straights that go on from each other."""
    numbers = array("d")
    shape = part.get("shape") if isinstance(part, dict) else None
    sound = (
        isinstance(shape, str)
        and len(shape) == 3
        and _TURN.keys() >= set(shape)
        and extended(numbers, part.get("start_pose"), 3)
        and extended(numbers, part.get("segment_length"), 3)
        and extended(numbers, [part.get("radius")], 1)
    )
    if not sound or not _drivable(numbers):
        raise DataError(
            f"{path}, lane {lane!r}: got {brief(part)}, expected a part of its middle line with start_pose, a shape "
            f"such as 'LSR', a radius from 0 on and three lengths up to {LONGEST:g} m"
        )
    x, y, heading, *lengths, radius = numbers
    points = [np.array([[x, y]])]
    for letter, length in zip(str(shape), lengths, strict=True):
        curvature = _TURN[letter] / radius if radius else 0.0
        along = np.linspace(0.0, length, max(1, math.ceil(length / STEP)) + 1)[1:]
        turned = heading + curvature * along
        chord = along * np.sinc(curvature * along / (2 * np.pi))
        way = (heading + turned) / 2  # of a chord of the arc
        points.append(points[-1][-1] + chord[:, None] * np.column_stack([np.cos(way), np.sin(way)]))
        heading = float(turned[-1])
    return np.concatenate(points)


def _drivable(numbers: array[float]) -> bool:
    *pose, a, b, c, radius = numbers
    return all(abs(value) <= LIMIT for value in pose) and all(0 <= n <= LONGEST for n in (a, b, c)) and radius >= 0


def _read_rings(path: Path, wanted: set[str], read: Read) -> dict[str, list[str]]:
    """Tokens of the nodes around each of the polygons ``wanted``."""
    rings: dict[str, list[str]] = {}
    for record in read_list(path, "polygon", read):
        token = text(path, record, "token")
        if token in wanted:
            nodes = record.get("exterior_node_tokens")
            if not isinstance(nodes, list) or not all(isinstance(node, str) for node in nodes):
                raise DataError(f"{path}, {named(record)}: exterior_node_tokens is {brief(nodes)}, expected tokens")
            rings[token] = nodes
    _require(path, "polygon", wanted - rings.keys())
    return rings


def _read_nodes(path: Path, wanted: set[str], read: Read) -> dict[str, tuple[float, float]]:
    """Places of the nodes ``wanted``."""
    found: dict[str, tuple[float, float]] = {}
    for record in read_list(path, "node", read):
        token = text(path, record, "token")
        if token in wanted:
            place = array("d")
            if not extended(place, [record.get("x"), record.get("y")], 2) or not all(abs(v) <= LIMIT for v in place):
                raise DataError(f"{path}, {named(record)}: x and y are no numbers up to {LIMIT:g}: {brief(record)}")
            found[token] = place[0], place[1]
    _require(path, "node", wanted - found.keys())
    return found


def _require(path: Path, layer: str, lost: set[str]) -> None:
    if lost:
        raise DataError(f"{path}: its layer {layer!r} has no record {min(lost)!r}, which a lane needs")


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
