"""Tables of nuScenes, decoded into typed records: scenes, keyframes and ego poses.

A file is read whole: ``sample_data.json`` of v1.0-trainval takes 1.2 GB for its text
and 1.1 GB for its records.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from ...core import DataError, Floats, Ints, starts_of
from ..rotation import require_rotations, yaw_of
from ..tables import refuse
from ..text import Number, read_json

SECOND_US = 1e6
# s, between samples: nominally 0.5
MIN_STEP_S = 0.25
MAX_STEP_S = 1.0
# its keyframes carry the ego pose of a sample, as in the official development kit
LIDAR = "LIDAR_TOP"
MAX_SIDE_M = 100.0  # of a box

Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]  # w x y z
_Pixels = Annotated[int, msgspec.Meta(ge=0, le=10**9)]
_Side = Annotated[float, msgspec.Meta(gt=0, le=MAX_SIDE_M)]
Size = tuple[_Side, _Side, _Side]  # width, length, height

ContentT = TypeVar("ContentT")


class TableRecord(msgspec.Struct, gc=False):
    """A record of a table; keys that are not declared are skipped."""

    token: str


RecordT = TypeVar("RecordT", bound=TableRecord)


def read_records(path: Path, kind: type[RecordT]) -> list[RecordT]:
    """Read all records of a table, in its order."""
    return read_json(path, list[kind])  # type: ignore[valid-type]


def by_token(path: Path, kind: type[RecordT]) -> dict[str, RecordT]:
    """Read the records of a table by their tokens.

    Raises DataError for a shared token.
    """
    table: dict[str, RecordT] = {}
    for record in read_records(path, kind):
        if record.token in table:
            raise DataError(
                f"{path}: several records have the token {record.token!r}, expected one"
            )
        table[record.token] = record
    return table


def find(
    table: Mapping[str, ContentT], record: TableRecord, key: str, path: Path
) -> ContentT:
    """Return the entry of ``table`` that the token ``key`` of a record names.

    ``path`` of the record's table. Raises DataError if the entry is missing.
    """
    token = getattr(record, key)
    if token not in table:
        name = key.removesuffix("_token")
        raise DataError(
            f"{path}, record {record.token!r}: {key} is {token!r}, but {name}.json has "
            "no such record"
        )
    return table[token]


def floats(rows: Sequence[Any], columns: int) -> Floats:
    """Return tuples of ``columns`` numbers as [R, columns]."""
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def rotations(records: Sequence[Any], path: Path) -> Floats:
    """Return quaternions [R, 4] of records of a table.

    Raises DataError unless of norm 1.
    """
    rotation = floats([record.rotation for record in records], 4)
    require_rotations(rotation, lambda row: f"{path}, record {records[row].token!r}")
    return rotation


def upright_boxes(records: Sequence[Any], rotation: Floats) -> Floats:
    """Return boxes [R, 7] x y z yaw l w h of records.

    They have a translation and a size; ``rotation`` [R, 4]: their quaternions.
    """
    place = floats([record.translation for record in records], 3)
    size = floats([record.size for record in records], 3)
    return np.column_stack([place, yaw_of(rotation), size[:, [1, 0, 2]]])


class SceneRecord(TableRecord):
    """A record of ``scene.json``; the name becomes that of a file."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$")]


class _Sample(TableRecord):
    scene_token: str
    # microseconds; a float has each of them exactly
    timestamp: Annotated[float, msgspec.Meta(ge=0, le=2.0**53)]


class _Sensor(TableRecord):
    channel: str


class _Channel(TableRecord):
    sensor_token: str


class MountRecord(TableRecord):
    """A record of ``calibrated_sensor.json``: the mount of a sensor."""

    translation: Vector  # m, in the frame of the ego
    rotation: Quaternion


class CameraRecord(MountRecord):
    """A record of ``calibrated_sensor.json`` with what a camera shows."""

    camera_intrinsic: list[Vector]  # 3 rows; none for other sensors


class DataRecord(TableRecord):
    """A record of ``sample_data.json``."""

    sample_token: str
    ego_pose_token: str
    calibrated_sensor_token: str
    is_key_frame: bool


class ImageRecord(DataRecord):
    """A record of ``sample_data.json`` with file and size of an image, in pixels."""

    filename: str
    width: _Pixels
    height: _Pixels


class _Pose(TableRecord):
    translation: Vector
    rotation: Quaternion


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Samples of all scenes, in the order of the scenes' names and of time."""

    scene: tuple[str, ...]  # [S] names
    start: Ints  # [S + 1] first row of each scene
    token: list[str]  # [N] of the samples
    row: dict[str, int]  # row of each token
    time: Floats  # [N] microseconds
    ego: Floats  # [N, 4] x y z yaw, global frame
    to_lidar: Floats  # [N, 3, 4] transforms from the global frame


def read_keyframes(paths: Mapping[str, Path]) -> Keyframes:
    """Read the tables of scenes, samples, sensors and ego poses.

    DataError names the file and token that is wrong.
    """
    names, start, tokens, time = _read_samples(paths)
    row_of_token = {token: row for row, token in enumerate(tokens)}
    lidar_records = _read_lidar_records(paths, row_of_token)
    poses = [record.ego_pose_token for record in lidar_records]
    place, rotation = read_poses(paths["ego_pose"], paths["sample_data"], poses)
    ego = np.column_stack([place, yaw_of(rotation)])
    path = paths["calibrated_sensor"]
    all_mounts = by_token(path, MountRecord)
    # channels were looked up with these tokens
    mounts = [all_mounts[record.calibrated_sensor_token] for record in lidar_records]
    to_lidar = to_sensors(place, rotation, mounts, path)
    return Keyframes(names, start, tokens, row_of_token, time, ego, to_lidar)


def _read_samples(
    paths: Mapping[str, Path],
) -> tuple[tuple[str, ...], Ints, list[str], Floats]:
    """Return scene names [S] and row starts [S + 1], sample tokens and times [N]."""
    scene_path = paths["scene"]
    sample_path = paths["sample"]
    scene_records = by_token(scene_path, SceneRecord).values()
    scenes = sorted(scene_records, key=lambda scene: (scene.name, scene.token))
    names = tuple(scene.name for scene in scenes)
    for name, next_name in pairwise(names):
        if name == next_name:
            raise DataError(f"{scene_path} has several scenes {name!r}, expected one")
    row_of_scene = {scene.token: row for row, scene in enumerate(scenes)}
    samples = list(by_token(sample_path, _Sample).values())
    scene_rows = [
        find(row_of_scene, sample, "scene_token", sample_path) for sample in samples
    ]
    scene_row = np.array(scene_rows, dtype=np.int64)
    sample_count = np.bincount(scene_row, minlength=len(scenes))
    problem = f"{sample_path.name} has no sample of this scene"
    refuse(
        sample_count == 0,
        lambda row: f"{scene_path}, record {scenes[row].token!r}: {problem}",
    )
    time = floats([sample.timestamp for sample in samples], 1)[:, 0]
    sample_order = np.lexsort((time, scene_row))
    start = starts_of(sample_count)
    tokens = [samples[row].token for row in sample_order]
    _check_steps(sample_path, names, start, tokens, time[sample_order])
    return names, start, tokens, time[sample_order]


def _check_steps(
    path: Path, names: Sequence[str], start: Ints, tokens: Sequence[str], time: Floats
) -> None:
    """Raise DataError for a scene whose steps are not about half a second.

    Most likely its times have another unit than microseconds.
    """
    for name, first, end in zip(names, start[:-1], start[1:], strict=True):
        steps_s = np.diff(time[first:end]) / SECOND_US
        if not len(steps_s):
            continue
        median_s = float(np.median(steps_s))
        # two samples at one time are wrong, too
        if not steps_s.all() or not MIN_STEP_S <= median_s <= MAX_STEP_S:
            row = first + int(np.argmin(steps_s))
            raise DataError(
                f"{path}, record {tokens[row]!r}: the samples of {name} are "
                f"{median_s:g} s apart (median), at least {steps_s.min():g} s; "
                f"expected {MIN_STEP_S:g} to {MAX_STEP_S:g} s. Check that timestamp is "
                "in microseconds"
            )


def read_channels(paths: Mapping[str, Path]) -> dict[str, str]:
    """Read the channel of each calibrated sensor by its token."""
    path = paths["calibrated_sensor"]
    sensors = by_token(paths["sensor"], _Sensor)
    channels: dict[str, str] = {}
    for token, mount in by_token(path, _Channel).items():
        channels[token] = find(sensors, mount, "sensor_token", path).channel
    return channels


def _read_lidar_records(
    paths: Mapping[str, Path], row_of_token: Mapping[str, int]
) -> list[DataRecord]:
    """Read the LIDAR_TOP keyframe [N] of each sample."""
    path = paths["sample_data"]
    channels = read_channels(paths)
    keyframes: dict[str, DataRecord] = {}
    for record in read_records(path, DataRecord):
        channel = find(channels, record, "calibrated_sensor_token", path)
        if channel != LIDAR or not record.is_key_frame:
            continue
        find(row_of_token, record, "sample_token", path)  # refuses an unknown one
        if record.sample_token in keyframes:
            raise DataError(
                f"{path}, record {record.token!r}: a second {LIDAR} keyframe of its "
                "sample"
            )
        keyframes[record.sample_token] = record
    for token in row_of_token:
        if token not in keyframes:
            raise DataError(f"{path} has no {LIDAR} keyframe of sample {token!r}")
    return [keyframes[token] for token in row_of_token]


def read_poses(
    path: Path, referring_path: Path, tokens: Sequence[str]
) -> tuple[Floats, Floats]:
    """Read places [N, 3] and quaternions [N, 4] of the ego by pose tokens [N].

    A table has many more poses. ``referring_path``: the table that names them.
    Raises DataError for a pose that is missing, or that two records share.
    """
    poses = by_token(path, _Pose)
    for token in tokens:
        if token not in poses:
            raise DataError(
                f"{path} has no record {token!r}, which {referring_path.name} names as "
                "ego_pose_token"
            )
    records = [poses[token] for token in tokens]
    place = floats([record.translation for record in records], 3)
    return place, rotations(records, path)


def to_sensors(
    place: Floats, rotation: Floats, mounts: Sequence[MountRecord], path: Path
) -> Floats:
    """Return transforms [n, 3, 4] from the global frame to that of each sensor.

    ``place`` [n, 3] and quaternions ``rotation`` [n, 4] of the ego; ``mounts`` [n] of
    the sensors, in the table ``path``. Raises DataError for a wrong rotation.
    """
    mount_place = floats([mount.translation for mount in mounts], 3)
    to_ego = _matrices(rotation).swapaxes(1, 2)
    to_mount = _matrices(rotations(mounts, path)).swapaxes(1, 2)
    # a place p is at to_mount (to_ego p - shift) in the sensor
    shift = np.einsum("nij,nj->ni", to_ego, place) + mount_place
    pose = np.concatenate([to_ego, -shift[..., None]], axis=2)
    return np.asarray(to_mount @ pose)


def _matrices(rotation: Floats) -> Floats:
    """Return rotation matrices [n, 3, 3] of quaternions [n, 4] w x y z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(rotation[:, [1, 2, 3, 0]]).as_matrix())
