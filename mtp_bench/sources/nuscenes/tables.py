"""Tables of nuScenes, decoded by msgspec into typed records; scenes, their samples (keyframes) and the ego poses.

A file is read whole: ``sample_data.json`` of v1.0-trainval takes 1.2 GB for its text and 1.1 GB for its records.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from ...core import DataError, Floats, Ints, starts_of
from ..text import LIMIT, read_json, refuse

SECOND = 1e6  # microseconds
STEPS = 0.25, 1.0  # s, between samples: nominally 0.5
LIDAR = "LIDAR_TOP"  # its keyframes carry the ego pose of a sample, as in the official development kit
LONGEST = 100.0  # m, side of a box
NORM_TOLERANCE = (
    1e-2  # of a quaternion; smaller deviations are rounding and are normalised
)

Number = Annotated[float, msgspec.Meta(ge=-LIMIT, le=LIMIT)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]  # w x y z
_Pixels = Annotated[int, msgspec.Meta(ge=0, le=10**9)]
_Side = Annotated[float, msgspec.Meta(gt=0, le=LONGEST)]
Size = tuple[_Side, _Side, _Side]  # width, length, height

Content = TypeVar("Content")


class TableRecord(msgspec.Struct, gc=False):
    """A record of a table; keys that are not declared are skipped."""

    token: str


RecordT = TypeVar("RecordT", bound=TableRecord)


def read_records(path: Path, kind: type[RecordT]) -> list[RecordT]:
    """All records of a table, in its order."""
    return read_json(path, list[kind])  # type: ignore[valid-type]


def by_token(path: Path, kind: type[RecordT]) -> dict[str, RecordT]:
    """Records of a table by their tokens; raises DataError for a token that two of them share."""
    records = read_records(path, kind)
    table = {record.token: record for record in records}
    if len(table) < len(records):
        token = next(
            record.token for record in records if table[record.token] is not record
        )
        raise DataError(
            f"{path}: several records have the token {token!r}, expected one"
        )
    return table


def find(
    table: dict[str, Content], record: TableRecord, key: str, path: Path
) -> Content:
    """Entry of ``table`` that the token ``key`` of a record of ``path`` names; raises DataError if it is missing."""
    token = getattr(record, key)
    if token not in table:
        name = key.removesuffix("_token")
        raise DataError(
            f"{path}, record {record.token!r}: {key} is {token!r}, but {name}.json has no such record"
        )
    return table[token]


def floats(rows: Sequence[Any], columns: int) -> Floats:
    """Tuples of ``columns`` numbers as ``[R, columns]``."""
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def require_rotations(rotation: Floats, where: Callable[[int], str]) -> None:
    """Raise DataError for the first row of quaternions ``[R, 4]`` that are not of norm 1; ``where``: name of a row."""
    wrong = np.abs(np.linalg.norm(rotation, axis=1) - 1.0) > NORM_TOLERANCE
    refuse(
        wrong,
        lambda row: (
            f"{where(row)}: rotation is {rotation[row].tolist()}, expected a unit quaternion"
        ),
    )


def yaw_of(rotation: Floats) -> Floats:
    """Headings ``[R]`` of quaternions ``[R, 4]`` (w, x, y, z): the turned x axis, projected on the ground."""
    w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    return np.asarray(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def rotations(records: Sequence[Any], path: Path) -> Floats:
    """Quaternions ``[R, 4]`` of records of a table; raises DataError for one that is not of norm 1."""
    rotation = floats([record.rotation for record in records], 4)
    require_rotations(rotation, lambda row: f"{path}, record {records[row].token!r}")
    return rotation


def upright_boxes(records: Sequence[Any], rotation: Floats) -> Floats:
    """Boxes ``[R, 7]`` x y z yaw l w h of records with a translation and a size, and their quaternions ``[R, 4]``."""
    place, size = (
        floats([each.translation for each in records], 3),
        floats([each.size for each in records], 3),
    )
    return np.column_stack([place, yaw_of(rotation), size[:, [1, 0, 2]]])


class SceneRecord(TableRecord):
    """A record of ``scene.json``; the name becomes that of a file."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$")]


class _Sample(TableRecord):
    scene_token: str
    timestamp: Annotated[
        float, msgspec.Meta(ge=0, le=2.0**53)
    ]  # microseconds; a float holds each of them exactly


class SensorRecord(TableRecord):
    """A record of ``sensor.json``."""

    channel: str


class MountRecord(TableRecord):
    """A record of ``calibrated_sensor.json``."""

    sensor_token: str


class CameraRecord(MountRecord):
    """A record of ``calibrated_sensor.json``: how a sensor is mounted, and what a camera shows."""

    translation: Vector  # m, in the frame of the ego
    rotation: Quaternion
    camera_intrinsic: list[Vector]  # 3 rows; none for other sensors


class DataRecord(TableRecord):
    """A record of ``sample_data.json``."""

    sample_token: str
    ego_pose_token: str
    calibrated_sensor_token: str
    is_key_frame: bool


class ImageRecord(DataRecord):
    """A record of ``sample_data.json`` with the file and the size of an image, in pixels."""

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


def read_keyframes(paths: Mapping[str, Path]) -> Keyframes:
    """Read the tables of scenes, samples, sensors and ego poses; DataError names the file and token that is wrong."""
    scene, start, token, time = _read_samples(paths)
    row = {name: index for index, name in enumerate(token)}
    pose = _read_lidar_poses(paths, row)
    position, rotation = read_poses(paths["ego_pose"], paths["sample_data"], pose)
    return Keyframes(
        scene, start, token, row, time, np.column_stack([position, yaw_of(rotation)])
    )


def _read_samples(
    paths: Mapping[str, Path],
) -> tuple[tuple[str, ...], Ints, list[str], Floats]:
    """Scene names [S] and row starts [S + 1], sample tokens [N] and times [N]."""
    path, table = paths["scene"], paths["sample"]
    scenes = sorted(
        by_token(path, SceneRecord).values(),
        key=lambda scene: (scene.name, scene.token),
    )
    for before, after in pairwise(scenes):
        if before.name == after.name:
            raise DataError(f"{path} has several scenes {before.name!r}, expected one")
    row = {scene.token: index for index, scene in enumerate(scenes)}
    samples = list(by_token(table, _Sample).values())
    group = np.array(
        [find(row, sample, "scene_token", table) for sample in samples], dtype=np.int64
    )
    count = np.bincount(group, minlength=len(scenes))
    refuse(
        count == 0,
        lambda i: (
            f"{path}, record {scenes[i].token!r}: {table.name} has no sample of this scene"
        ),
    )
    time = floats([sample.timestamp for sample in samples], 1)[:, 0]
    order = np.lexsort((time, group))
    start, tokens, time = (
        starts_of(count),
        [samples[index].token for index in order],
        time[order],
    )
    names = tuple(scene.name for scene in scenes)
    _check_steps(table, names, start, tokens, time)
    return names, start, tokens, time


def _check_steps(
    path: Path, scene: tuple[str, ...], start: Ints, token: list[str], time: Floats
) -> None:
    """Raise DataError for a scene whose steps are not about half a second: its times have another unit."""
    for name, first, end in zip(scene, start[:-1], start[1:], strict=True):
        steps = np.diff(time[first:end]) / SECOND
        step = float(np.median(steps)) if len(steps) else STEPS[0]
        if not steps.all() or not STEPS[0] <= step <= STEPS[1]:
            row = first + int(np.argmin(steps))
            raise DataError(
                f"{path}, record {token[row]!r}: the samples of {name} are {step:g} s apart (median), at least "
                f"{steps.min():g} s; expected {STEPS[0]:g} to {STEPS[1]:g} s: timestamp must be in microseconds"
            )


def _read_lidar_poses(paths: Mapping[str, Path], row: dict[str, int]) -> list[str]:
    """Token [N] of the ego pose of each sample: that of its LIDAR_TOP keyframe."""
    path, mounts = paths["sample_data"], paths["calibrated_sensor"]
    sensors = by_token(paths["sensor"], SensorRecord)
    mounted = by_token(mounts, MountRecord).items()
    channel = {
        token: find(sensors, mount, "sensor_token", mounts).channel
        for token, mount in mounted
    }
    pose = [""] * len(row)
    for record in read_records(path, DataRecord):
        if (
            find(channel, record, "calibrated_sensor_token", path) != LIDAR
            or not record.is_key_frame
        ):
            continue
        sample = find(row, record, "sample_token", path)
        if pose[sample]:
            raise DataError(
                f"{path}, record {record.token!r}: a second {LIDAR} keyframe of its sample"
            )
        pose[sample] = record.ego_pose_token
    if "" in pose:
        token = next(token for token, sample in row.items() if not pose[sample])
        raise DataError(f"{path} has no {LIDAR} keyframe of sample {token!r}")
    return pose


def read_poses(path: Path, referrer: Path, pose: list[str]) -> tuple[Floats, Floats]:
    """Places [N, 3] and quaternions [N, 4] of the ego by pose tokens [N]; a table has many more poses.

    ``referrer``: the table that names them. DataError for a pose that is missing, or that two records share.
    """
    poses = by_token(path, _Pose)
    missing = next((token for token in pose if token not in poses), None)
    if missing is not None:
        raise DataError(
            f"{path} has no record {missing!r}, which {referrer.name} names as ego_pose_token"
        )
    records = [poses[token] for token in pose]
    return floats([record.translation for record in records], 3), rotations(
        records, path
    )
