"""The road around a scene and the images of its cameras, for pictures of it.

Of a map of the expansion (v1.3) the layers ``lane`` and ``lane_connector`` (a way
through a junction) are read, and by the tokens of both ``arcline_path_3``, the middle
line in parts of three arcs or straights, and ``connectivity``, what continues it.
Images are kept per scene, since their tables have millions of records, and read when an
event is drawn.
"""

import math
from collections.abc import Collection, Mapping
from functools import lru_cache, partial
from pathlib import Path, PurePosixPath
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Lane, Scene, unit_vectors
from ..base import (
    CameraImage,
    DataRoot,
    is_near,
    lane_around,
    link_lanes,
    require_focal_lengths,
    section_of,
)
from ..cache import write_arrays
from ..text import read_json
from .layout import CAMERAS, DATASET, EXPANSION, VERSIONS, NuScenesSource
from .store import CachedFolder, TableStore, open_tables
from .tables import (
    CameraRecord,
    ImageRecord,
    SceneRecord,
    TableRecord,
    Vector,
    by_token,
    find,
    floats,
    read_channels,
    read_poses,
    read_records,
    rotations,
    to_sensors,
)

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

    Empty without a map of its location. Raises DataError for a map or a table that is
    wrong.
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
    # np.inf: the first point always stays
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
        # chord of an arc of the angle a: length sin(a / 2) / (a / 2)
        chord_m = station_m * np.sinc(curvature * station_m / (2 * np.pi))
        chord_heading = (heading + end_heading) / 2
        offset = chord_m[:, None] * unit_vectors(chord_heading)
        part_points.append(part_points[-1][-1] + offset)
        heading = float(end_heading[-1])
    return np.concatenate(part_points)


def scene_images(card: Card, data: DataRoot, scene: Scene) -> tuple[CameraImage, ...]:
    """Return the images of a scene whose files are there.

    DataError names the table and token that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not any(root.glob(CAMERAS)):
        return ()
    tables = open_tables(root, section_of(card, NuScenesSource).version)
    name = f"{tables.cache.path.name}-cameras"
    cache = CachedFolder.of(name, tables.cache.sources, partial(_fill, tables))
    arrays = cache.read(scene.name)
    images: list[CameraImage] = []
    for row, file in enumerate(arrays["path"].tolist()):
        if (root / file).is_file():
            width, height = arrays["size"][row].tolist()
            image = CameraImage(
                frame=arrays["frame"].item(row),
                camera=arrays["camera"].item(row),
                path=root / file,
                size=(width, height),
                projection=arrays["projection"][row],
            )
            images.append(image)
    return tuple(images)


def _fill(tables: TableStore, folder: Path) -> None:
    path = tables.cache.sources["sample_data"]
    channels = read_channels(tables.cache.sources)
    cameras = _read_cameras(tables.cache.sources["calibrated_sensor"], channels)
    images = _read_images(path, cameras)
    row_of_token = tables.row_of_token
    samples = [find(row_of_token, image, "sample_token", path) for image in images]
    sample = np.array(samples, dtype=np.int64)
    mounts = [image.calibrated_sensor_token for image in images]
    image_size = floats([(image.width, image.height) for image in images], 2)
    arrays = {
        "frame": sample,
        "camera": np.array([channels[mount] for mount in mounts], dtype=np.str_),
        "path": np.array([image.filename for image in images], dtype=np.str_),
        "size": np.maximum(image_size, 1).astype(np.int64),
        "projection": _projections(
            tables, images, [cameras[mount] for mount in mounts]
        ),
    }
    image_order = np.lexsort((arrays["camera"], sample))
    for name in tables.scenes:
        image_rows = image_order[tables.rows_of(name, sample[image_order])]
        scene_arrays = {key: values[image_rows] for key, values in arrays.items()}
        scene_arrays["frame"] = scene_arrays["frame"] - tables.samples(name).start
        write_arrays(folder / f"{name}.npz", scene_arrays)


def _read_images(path: Path, cameras: Collection[str]) -> list[ImageRecord]:
    """Read the records of the images of ``cameras`` (tokens) at keyframes."""
    images: list[ImageRecord] = []
    for record in read_records(path, ImageRecord):
        if not record.is_key_frame or record.calibrated_sensor_token not in cameras:
            continue
        parts = PurePosixPath(record.filename).parts
        if parts[:1] != ("samples",) or ".." in parts:
            raise DataError(
                f"{path}, record {record.token!r}: filename is {record.filename!r}, "
                "expected a file below samples/"
            )
        images.append(record)
    return images


def _read_cameras(path: Path, channels: Mapping[str, str]) -> dict[str, CameraRecord]:
    """Read the mount of each camera by token of the calibrated sensor."""
    cameras: dict[str, CameraRecord] = {}
    for token, mount in by_token(path, CameraRecord).items():
        if not channels[token].startswith("CAM_"):
            continue
        if len(mount.camera_intrinsic) != 3:
            raise DataError(
                f"{path}, record {token!r}: camera_intrinsic needs 3 rows of 3 numbers"
            )
        cameras[token] = mount
    rotations(list(cameras.values()), path)
    return cameras


def _projections(
    tables: TableStore, images: list[ImageRecord], mounts: list[CameraRecord]
) -> Floats:
    """Return projections [n, 3, 4] from the global frame to pixels of each image."""
    sources = tables.cache.sources
    path = sources["calibrated_sensor"]
    poses = [image.ego_pose_token for image in images]
    place, rotation = read_poses(sources["ego_pose"], sources["sample_data"], poses)
    intrinsic = floats([mount.camera_intrinsic for mount in mounts], 9)
    intrinsic = intrinsic.reshape(-1, 3, 3)
    require_focal_lengths(
        intrinsic, lambda row: f"{path}, record {mounts[row].token!r}"
    )
    return np.asarray(intrinsic @ to_sensors(place, rotation, mounts, path))
