"""The road around a scene, of the nuScenes map expansion (v1.3).

Of a map the layers ``lane`` and ``lane_connector`` (a way through a junction) are read,
and by the tokens of both ``arcline_path_3``, the middle line in parts of three arcs or
straights, and ``connectivity``, what continues it.
"""

import math
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Lane, Scene, unit_vectors
from ..base import DataRoot, is_near, lane_around, link_lanes, section_of
from ..text import read_json
from .layout import DATASET, EXPANSION, VERSIONS, NuScenesSource
from .tables import SceneRecord, TableRecord, Vector, by_token, find, read_records

# from the path of the ego, within which the road is read
ROAD_REACH_M = 100.0
MAX_STEP_M = 2.0  # between points of a middle line
# parts of a middle line meet in a point
_MIN_STEP_M = 1e-3
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
    """Return the lanes near the path of the ego, in the global frame.

    None if there is no map of its location. Raises DataError for a map or a table that
    is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not (root / EXPANSION).is_dir():
        return ()
    version = root / section_of(card, NuScenesSource).version
    path = root / EXPANSION / f"{location_of(version, scene.name)}.json"
    if not path.is_file():
        return ()
    lanes: dict[int, Lane] = {}
    for index, lane in enumerate(read_lanes(path, path.stat().st_mtime_ns)):
        if is_near(lane, scene.ego[:, :2], ROAD_REACH_M):
            lanes[index] = lane
    return link_lanes(lanes, {index: lane.following for index, lane in lanes.items()})


def location_of(version: Path, scene: str) -> str:
    """Return the place where a scene was recorded, such as "boston-seaport".

    ``version``: folder of the tables.
    """
    logs = by_token(version / "log.json", _Log)
    path = version / "scene.json"
    for record in read_records(path, _Scene):
        if record.name == scene:
            return find(logs, record, "log_token", path).location
    raise DataError(f"{path} has no scene {scene!r}")


@lru_cache(maxsize=1)
def read_lanes(path: Path, changed_ns: int = 0) -> tuple[Lane, ...]:
    """Read the lanes of a location, without bike lanes, in the global frame.

    Borders are at `base.HALF_LANE`. Successors without a middle line are left out. The
    last map is kept; ``changed_ns``: state of the file, for that memory. DataError
    names the file and the place that is wrong.
    """
    layers = read_json(path, _Map)
    junction = {lane.token: False for lane in layers.lane if lane.lane_type != "BIKE"}
    junction |= {lane.token: True for lane in layers.lane_connector}
    lanes: dict[str, Lane] = {}
    successors: dict[str, list[str]] = {}
    for token, is_junction in junction.items():
        center = _center(layers.arcline_path_3.get(token, []))
        if len(center) > 1:
            lanes[token] = lane_around(center, is_junction)
            successors[token] = layers.connectivity.get(token, _Links()).outgoing
    if not lanes:
        raise DataError(
            f"{path} has no lane with a middle line, expected a file of the map "
            "expansion"
        )
    return link_lanes(lanes, successors)


def _center(parts: list[_Path]) -> Floats:
    """Return points [n, 2] of a middle line."""
    line = np.concatenate([np.zeros((0, 2)), *(_points(part) for part in parts)])
    step_m = np.linalg.norm(np.diff(line, axis=0, prepend=np.inf), axis=1)
    return np.asarray(line[step_m > _MIN_STEP_M])


def _points(part: _Path) -> Floats:
    """Return points [n, 2] of one part of a middle line."""
    x, y, heading = part.start_pose
    part_points = [np.array([[x, y]])]
    for letter, length_m in zip(part.shape, part.segment_length, strict=True):
        curvature = _TURN[letter] / part.radius if part.radius else 0.0
        point_count = max(1, math.ceil(length_m / MAX_STEP_M)) + 1
        station_m = np.linspace(0.0, length_m, point_count)[1:]
        end_heading = heading + curvature * station_m
        chord_m = station_m * np.sinc(curvature * station_m / (2 * np.pi))
        chord_heading = (heading + end_heading) / 2
        offset = chord_m[:, None] * unit_vectors(chord_heading)
        part_points.append(part_points[-1][-1] + offset)
        heading = float(end_heading[-1])
    return np.concatenate(part_points)
