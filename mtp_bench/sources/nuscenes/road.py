"""The road around a scene, of the nuScenes map expansion (v1.3): lanes with their middle lines and successors.

Of a map the layers ``lane`` and ``lane_connector`` (a way through a junction) are read, and by the tokens of both
``arcline_path_3``, the middle line in parts of three arcs or straights, and ``connectivity``, what continues it.
"""

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Lane, Scene, unit_vectors
from ..base import DataRoot, lane_around, section_of
from ..text import read_json
from .layout import DATASET, EXPANSION, VERSIONS, NuScenesSource
from .tables import SceneRecord, TableRecord, Vector, by_token, find, read_records

REACH = 100.0  # m from the way of the ego, within which the road is read
STEP = 2.0  # m, between points of a middle line, at most
_TURN = {"L": 1.0, "S": 0.0, "R": -1.0}  # sign of the curvature
_Length = Annotated[float, msgspec.Meta(ge=0, le=5e3)]  # m


class _Log(TableRecord):
    location: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$")]


class _Scene(SceneRecord):
    log_token: str


class _Path(msgspec.Struct):
    """Up to three arcs or straights that go on from each other."""

    start_pose: Vector  # x y heading
    shape: Annotated[str, msgspec.Meta(pattern="^[LSR]{3}$")]
    segment_length: tuple[_Length, _Length, _Length]
    radius: Annotated[float, msgspec.Meta(ge=0)]


class _Lane(TableRecord):
    lane_type: str = "CAR"


class _Links(msgspec.Struct):
    outgoing: list[str] = []  # tokens


class _Map(msgspec.Struct):
    lane: list[_Lane] = []
    lane_connector: list[TableRecord] = []
    arcline_path_3: dict[str, list[_Path]] = {}
    connectivity: dict[str, _Links] = {}


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """The lanes near the way of the ego, in the global frame; none if there is no map of its location.

    Raises DataError for a map or a table that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not (root / EXPANSION).is_dir():
        return ()
    path = (
        root
        / EXPANSION
        / f"{location_of(root / section_of(card, NuScenesSource).version, scene.name)}.json"
    )
    if not path.is_file():
        return ()
    ego = scene.ego[:, None, :2]
    lanes = read_lanes(path, path.stat().st_mtime_ns)
    near = (
        i
        for i, lane in enumerate(lanes)
        if (np.linalg.norm(lane.center - ego, axis=2) <= REACH).any()
    )
    number = {i: place for place, i in enumerate(near)}
    after = (
        tuple(number[each] for each in lanes[i].following if each in number)
        for i in number
    )
    return tuple(
        replace(lanes[i], following=following)
        for i, following in zip(number, after, strict=True)
    )


def location_of(version: Path, scene: str) -> str:
    """The place where a scene was recorded, such as "boston-seaport", by the tables in the folder ``version``."""
    logs, path = by_token(version / "log.json", _Log), version / "scene.json"
    for record in read_records(path, _Scene):
        if record.name == scene:
            return find(logs, record, "log_token", path).location
    raise DataError(f"{path} has no scene {scene!r}")


@lru_cache(maxsize=1)
def read_lanes(path: Path, changed: int = 0) -> tuple[Lane, ...]:
    """The lanes of a location, but for bike lanes, in the global frame, with borders at `base.HALF_LANE`.

    Successors without a middle line are left out. The last map is kept; ``changed``: state of the file, for that
    memory. DataError names the file and the place that is wrong.
    """
    layers = read_json(path, _Map)
    junction = {lane.token: False for lane in layers.lane if lane.lane_type != "BIKE"}
    junction |= {lane.token: True for lane in layers.lane_connector}
    centers = (
        (token, _center(layers.arcline_path_3.get(token, []))) for token in junction
    )
    lines = {token: center for token, center in centers if len(center) > 1}
    if not lines:
        raise DataError(
            f"{path} has no lane with a middle line, expected a file of the map expansion"
        )
    number = {token: i for i, token in enumerate(lines)}
    outgoing = (layers.connectivity.get(token, _Links()).outgoing for token in lines)
    after = (
        tuple(number[token] for token in tokens if token in number)
        for tokens in outgoing
    )
    lanes = (lane_around(center, junction[token]) for token, center in lines.items())
    return tuple(
        replace(lane, following=following)
        for lane, following in zip(lanes, after, strict=True)
    )


def _center(parts: list[_Path]) -> Floats:
    """Points [n, 2] of a middle line."""
    line = np.concatenate([np.zeros((0, 2)), *(_points(part) for part in parts)])
    moves = (
        np.linalg.norm(np.diff(line, axis=0, prepend=np.inf), axis=1) > 1e-3
    )  # parts meet in a point
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
        points.append(points[-1][-1] + chord[:, None] * unit_vectors(way))
        heading = float(turned[-1])
    return np.concatenate(points)
