"""Boxes of all objects: the tables of annotations, and the prediction targets."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core import Bools, DataError, Floats, Ints, select
from ..base import class_ids, sorted_rows
from ..tables import refuse, repeated
from ..text import read_json
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
    """Boxes of the classes of the detection task, neutral ones included.

    They are sorted by sample and place in the table.
    """

    sample: Ints  # [R] row of the keyframe
    instance: NDArray[np.bytes_]  # [R] token
    box: Floats  # [R, 7] global frame
    class_id: Ints  # [R] index into CLASSES
    # [R] of a category beside the evaluated ones, or without a point of lidar and radar
    neutral: Bools
    listed: Bools  # [R] a target of the prediction challenge


def read_annotations(
    paths: Mapping[str, Path], prediction: Path | None, keyframes: Keyframes
) -> TrueBoxes:
    """Read the boxes of all objects.

    ``paths``: tables by name; ``prediction``: file of the prediction targets, if any.
    DataError names the file and token that is wrong.
    """
    instances = by_token(paths["instance"], _Instance)
    box_path = paths["sample_annotation"]
    box_records = list(by_token(box_path, _Box).values())
    row_of_instance = {token: row for row, token in enumerate(instances)}
    samples = [
        find(keyframes.row, box, "sample_token", box_path) for box in box_records
    ]
    rows = [
        find(row_of_instance, box, "instance_token", box_path) for box in box_records
    ]
    sample = np.array(samples, dtype=np.int64)
    instance = np.array(rows, dtype=np.int64)
    problem = "a second box of its instance in its sample"
    refuse(
        repeated(sample, instance),
        lambda row: f"{box_path}, record {box_records[row].token!r}: {problem}",
    )
    box = upright_boxes(box_records, rotations(box_records, box_path))
    listed = np.zeros(len(box_records), dtype=bool)
    if prediction is not None:
        box_key = instance * len(keyframes.token) + sample
        targets = _read_targets(prediction, row_of_instance, keyframes, box_key)
        listed = np.isin(box_key, targets)
    categories = by_token(paths["category"], _Category)
    category_names = [
        find(categories, record, "category_token", paths["instance"]).name
        for record in instances.values()
    ]
    class_of = {**NEUTRAL_OF, **CLASS_OF}
    class_names = [class_of.get(name, "") for name in category_names]
    class_id = class_ids(class_names, CLASSES)[instance]
    is_neutral = np.array([name in NEUTRAL_OF for name in category_names], dtype=bool)
    has_no_points = [
        record.num_lidar_pts == record.num_radar_pts == 0 for record in box_records
    ]
    neutral = is_neutral[instance] | np.array(has_no_points, dtype=bool)
    instance_tokens = np.array([token.encode() for token in instances], dtype=np.bytes_)
    box_order = sorted_rows(sample, class_id >= 0)
    boxes = TrueBoxes(sample, instance_tokens[instance], box, class_id, neutral, listed)
    return select(boxes, box_order)


def _read_targets(
    path: Path,
    row_of_instance: Mapping[str, int],
    keyframes: Keyframes,
    box_keys: Ints,
) -> Ints:
    """Return the keys of the targets in scenes of these tables.

    A key is instance x samples + sample. ``box_keys``: keys of all boxes.
    """
    samples = len(keyframes.token)
    targets = read_json(path, dict[str, list[str]])
    entry_of_key: dict[int, str] = {}
    for index, scene in enumerate(keyframes.scene):
        scene_rows = range(keyframes.start[index], keyframes.start[index + 1])
        for entry in targets.get(scene, []):
            instance, _, sample = entry.partition("_")
            row = keyframes.row.get(sample, -1)
            if instance not in row_of_instance or row not in scene_rows:
                raise DataError(
                    f"{path}, {scene}, entry {entry!r}: expected the tokens of an "
                    "instance and of a sample of the scene"
                )
            entry_of_key[row_of_instance[instance] * samples + row] = entry
    target_keys = np.array(list(entry_of_key), dtype=np.int64)
    missing = np.setdiff1d(target_keys, box_keys).tolist()
    if missing:
        raise DataError(
            f"{path}, entry {entry_of_key[missing[0]]!r}: the instance has no box in "
            "this sample"
        )
    return target_keys
