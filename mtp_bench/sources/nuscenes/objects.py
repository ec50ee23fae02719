"""Boxes of all objects: the tables of categories, instances and annotations, and the list of prediction targets."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core import Bools, DataError, Floats, Ints, select
from ..text import read_json, refuse, repeated
from .layout import CLASS_OF, CLASSES, NEUTRAL_OF
from .tables import (
    Keyframes,
    Quaternion,
    Size,
    TableRecord,
    Vector,
    by_token,
    find,
    rotations,
    upright_boxes,
)


class _Category(TableRecord):
    name: str


class _Instance(TableRecord):
    category_token: str


class _Box(TableRecord):
    sample_token: str
    instance_token: str
    translation: Vector
    size: Size
    rotation: Quaternion
    num_lidar_pts: int | None = None  # tables of other makers may not count points
    num_radar_pts: int | None = None


@dataclass(frozen=True, eq=False)
class TrueBoxes:
    """Boxes of the classes of the detection task, neutral ones included, sorted by sample and place in the table."""

    sample: Ints  # [R] row of the keyframe
    instance: NDArray[np.bytes_]  # [R] token
    box: Floats  # [R, 7] global frame
    class_id: Ints  # [R] index into CLASSES
    neutral: Bools  # [R] of a category beside the evaluated ones, or without a point of lidar and radar
    listed: Bools  # [R] a target of the prediction challenge


def read_annotations(
    paths: Mapping[str, Path], prediction: Path | None, keyframes: Keyframes
) -> TrueBoxes:
    """Read all boxes; ``prediction``: the list of targets, if any. DataError names the file and token that is wrong."""
    instances, categories = (
        by_token(paths["instance"], _Instance),
        by_token(paths["category"], _Category),
    )
    names = [
        find(categories, each, "category_token", paths["instance"]).name
        for each in instances.values()
    ]
    path = paths["sample_annotation"]
    records = list(by_token(path, _Box).values())
    row = {token: index for index, token in enumerate(instances)}
    sample = np.array(
        [find(keyframes.row, record, "sample_token", path) for record in records],
        dtype=np.int64,
    )
    instance = np.array(
        [find(row, record, "instance_token", path) for record in records],
        dtype=np.int64,
    )
    second = repeated(sample, instance)
    refuse(
        second,
        lambda i: (
            f"{path}, record {records[i].token!r}: a second box of its instance in its sample"
        ),
    )
    box = upright_boxes(records, rotations(records, path))
    listed = np.zeros(len(records), dtype=bool)
    if prediction is not None:
        key = instance * len(keyframes.token) + sample
        listed = np.isin(key, _read_targets(prediction, row, keyframes, key))
    used_as = [CLASS_OF.get(name) or NEUTRAL_OF.get(name) for name in names]
    class_of = np.array(
        [-1 if name is None else CLASSES.index(name) for name in used_as],
        dtype=np.int64,
    )
    neutral = np.array([name in NEUTRAL_OF for name in names], dtype=bool)[instance]
    neutral |= np.array(
        [record.num_lidar_pts == record.num_radar_pts == 0 for record in records],
        dtype=bool,
    )
    token = np.array([token.encode() for token in instances], dtype=np.bytes_)
    used = np.flatnonzero(class_of[instance] >= 0)
    order = used[np.argsort(sample[used], kind="stable")]
    return select(
        TrueBoxes(sample, token[instance], box, class_of[instance], neutral, listed),
        order,
    )


def _read_targets(
    path: Path, instances: Mapping[str, int], keyframes: Keyframes, known: Ints
) -> Ints:
    """Keys (instance x samples + sample) of the targets in scenes of these tables; ``known``: keys of all boxes."""
    targets = read_json(path, dict[str, list[str]])
    keys: list[int] = []
    for index, scene in enumerate(keyframes.scene):
        own = range(keyframes.start[index], keyframes.start[index + 1])
        for entry in targets.get(scene, []):
            instance, _, sample = entry.partition("_")
            if instance not in instances or keyframes.row.get(sample, -1) not in own:
                expected = (
                    "expected the tokens of an instance and of a sample of the scene"
                )
                raise DataError(f"{path}, {scene}, entry {entry!r}: {expected}")
            keys.append(
                instances[instance] * len(keyframes.token) + keyframes.row[sample]
            )
    key = np.array(keys, dtype=np.int64)
    if len(lost := np.setdiff1d(key, known)):
        instance_row, sample_row = divmod(int(lost[0]), len(keyframes.token))
        entry = f"{list(instances)[instance_row]}_{keyframes.token[sample_row]}"
        raise DataError(
            f"{path}, entry {entry!r}: the instance has no box in this sample"
        )
    return key
