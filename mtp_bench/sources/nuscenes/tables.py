"""Scenes, their samples (keyframes) in order, and the ego pose of each: six of the tables."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...errors import DataError
from ...types import Floats, Ints, starts_of
from .fields import add_numbers, check, floats, ints, named, text, time_stamp, whole, yaw_of
from .json_stream import Read, Record, brief, read_records

Value = TypeVar("Value")

SECOND = 1e6  # microseconds
STEPS = 0.25, 1.0  # s, between samples: nominally 0.5
LIDAR = "LIDAR_TOP"  # its keyframes carry the ego pose of a sample, as in the official development kit


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Samples of all scenes, in the order of the scenes' names and of time."""

    scene: tuple[str, ...]  # [S] names
    start: Ints  # [S + 1] first row of each scene
    token: list[str]  # [N] of the samples
    row: Mapping[str, int]  # row of each token
    time: Floats  # [N] microseconds
    ego: Floats  # [N, 4] x y z yaw, global frame


def read_keyframes(paths: Mapping[str, Path], read: Read) -> Keyframes:
    """Read the tables of scenes, samples, sensors and ego poses; DataError names the file and token that is wrong."""
    scene, start, token, time = _read_samples(paths, read)
    row = {name: at for at, name in enumerate(token)}
    pose = _read_lidar_poses(paths, row, read)
    position, turn = read_poses(paths["ego_pose"], paths["sample_data"], pose, read)
    return Keyframes(scene, start, token, row, time, np.column_stack([position, yaw_of(turn)]))


def _read_samples(paths: Mapping[str, Path], read: Read) -> tuple[tuple[str, ...], Ints, list[str], Floats]:
    """Scene names [S] and row starts [S + 1], sample tokens [N] and times [N]."""
    path, table = paths["scene"], paths["sample"]
    scenes = sorted(
        (_scene_name(path, record), token, whole(path, record, "nbr_samples")) for token, record in by_token(path, read)
    )
    names, own = tuple(name for name, _, _ in scenes), [token for _, token, _ in scenes]
    for name, following in pairwise(names):
        if name == following:
            raise DataError(f"{path} has several scenes {name!r}, expected one")
    place = {token: at for at, token in enumerate(own)}
    samples, group, times = list[str](), array("q"), array("d")
    for token, record in by_token(table, read):
        samples.append(token)
        group.append(known(place, record, table, "scene"))
        times.append(time_stamp(table, record, "timestamp"))
    count, scene = np.array([number for _, _, number in scenes], dtype=np.int64), ints(group)
    require_counts(path, own, count, scene, table)
    time = floats(times, 1)[:, 0]
    order = np.lexsort((time, scene))
    start, ordered, time = starts_of(count), [samples[i] for i in order], time[order]
    _check_steps(table, names, start, ordered, time)
    return names, start, ordered, time


def require_counts(path: Path, token: Sequence[str], said: Ints, group: Ints, table: Path) -> None:
    """Raise DataError unless each record of ``path`` has as many rows of ``table`` as it says, and at least one.

    ``token`` and ``said``: of the records [G]; ``group``: the record of each row [R].
    """
    found = np.bincount(group, minlength=len(token))
    for at in np.flatnonzero((found != said) | (found == 0))[:1]:
        raise DataError(
            f"{path}, record {token[at]!r}: says that it has {said[at]} records in {table.name}, found {found[at]}"
        )


def _check_steps(path: Path, scene: tuple[str, ...], start: Ints, token: list[str], time: Floats) -> None:
    """Raise DataError for a scene whose steps are not about half a second: its times have another unit."""
    for name, first, end in zip(scene, start[:-1], start[1:], strict=True):
        steps = np.diff(time[first:end])
        if not steps.all():
            at = first + int(np.argmin(steps))
            raise DataError(f"{path}, record {token[at]!r}: another sample of {name} has its time")
        step = float(np.median(steps)) / SECOND if len(steps) else STEPS[0]
        if not STEPS[0] <= step <= STEPS[1]:
            raise DataError(
                f"{path}, record {token[first]!r}: the samples of {name} are {step:g} s apart (median), expected "
                f"{STEPS[0]:g} to {STEPS[1]:g} s: timestamp must be in microseconds"
            )


def _scene_name(path: Path, record: Record) -> str:
    """The name of a scene, which becomes the name of a file."""
    name = text(path, record, "name")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise DataError(f"{path}, {named(record)}: name is {brief(name)}, expected a name like 'scene-0061'")
    return name


def _read_lidar_poses(paths: Mapping[str, Path], row: Mapping[str, int], read: Read) -> list[str]:
    """Token [N] of the ego pose of each sample: that of its LIDAR_TOP keyframe."""
    path = paths["sample_data"]
    channel = {token: text(paths["sensor"], record, "channel") for token, record in by_token(paths["sensor"], read)}
    mounted: dict[str, str] = {}
    for token, record in by_token(paths["calibrated_sensor"], read):
        mounted[token] = known(channel, record, paths["calibrated_sensor"], "sensor")
    pose = [""] * len(row)
    for record in read_records(path, read):
        if known(mounted, record, path, "calibrated_sensor") != LIDAR or record.get("is_key_frame") is not True:
            continue
        at = known(row, record, path, "sample")
        if pose[at]:
            raise DataError(f"{path}, record {record.get('token')!r}: a second {LIDAR} keyframe of its sample")
        pose[at] = text(path, record, "ego_pose_token")
    for token, at in row.items():
        if not pose[at]:
            raise DataError(f"{path} has no {LIDAR} keyframe of sample {token!r}")
    return pose


def read_poses(path: Path, referrer: Path, pose: list[str], read: Read) -> tuple[Floats, Floats]:
    """Places [N, 3] and quaternions [N, 4] of the ego by pose tokens [N]; a table has many more poses.

    ``referrer``: the table that names them. DataError for a pose that is not there, or that two records share.
    """
    wanted: dict[str, int] = dict.fromkeys(pose, -1)
    translation, rotation, tokens = array("d"), array("d"), list[str]()
    for token, record in by_token(path, read):
        if token not in wanted:
            continue
        wanted[token] = len(tokens)
        tokens.append(token)
        add_numbers(path, record, "translation", 3, translation)
        add_numbers(path, record, "rotation", 4, rotation)
    for token, at in wanted.items():
        if at < 0:
            raise DataError(f"{path} has no record {token!r}, which {referrer.name} names as ego_pose_token")
    position, turn = floats(translation, 3), floats(rotation, 4)
    check(path, tokens, {"translation": position, "rotation": turn})
    row = np.array([wanted[token] for token in pose], dtype=np.int64)
    return position[row], turn[row]


def by_token(path: Path, read: Read) -> Iterator[tuple[str, Record]]:
    """Records of a table with their tokens; DataError for a token that two of them share."""
    seen: set[str] = set()
    for record in read_records(path, read):
        token = text(path, record, "token")
        if token in seen:
            raise DataError(f"{path}: several records have the token {token!r}, expected one")
        seen.add(token)
        yield token, record


def known(table: Mapping[str, Value], record: Record, path: Path, name: str) -> Value:
    """Entry of ``table`` for the token of a ``name`` in a record of ``path``; DataError where there is none."""
    token = text(path, record, f"{name}_token")
    if token not in table:
        raise DataError(
            f"{path}, record {record.get('token')!r}: {name}_token is {token!r}, but {name}.json has no such record"
        )
    return table[token]
