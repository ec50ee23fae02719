"""Boxes of all objects: the tables of categories, instances and annotations, and the list of prediction targets."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Bools, Floats, Ints
from ..text import read_json
from .classes import NEUTRAL_OF, class_index
from .fields import add_numbers, check, floats, ints, text, upright_boxes, whole
from .json_stream import Read, Record, brief
from .tables import Keyframes, by_token, known, require_counts

_POINTS = ("num_lidar_pts", "num_radar_pts")


@dataclass(frozen=True, eq=False)
class Annotations:
    """Boxes of the classes of the detection task, neutral ones included, sorted by sample and place in the table."""

    sample: Ints  # [R] row of the keyframe
    instance: Ints  # [R]
    box: Floats  # [R, 7] global frame
    class_id: Ints  # [R] index into CLASSES
    neutral: Bools  # [R] of a category beside the evaluated ones, or without a point of lidar and radar
    listed: Bools  # [R] a target of the prediction challenge
    token: list[str]  # of all instances
    boxes: int  # of all categories


@dataclass(frozen=True, eq=False)
class _Table:
    """Rows of ``sample_annotation.json``."""

    token: list[str]
    sample: Ints  # [R] row of the keyframe
    instance: Ints  # [R]
    box: Floats  # [R, 7]
    hidden: Bools  # [R] no point of lidar and radar is in it


def read_annotations(
    paths: Mapping[str, Path], prediction: Path | None, keyframes: Keyframes, read: Read
) -> Annotations:
    """Read all boxes; ``prediction``: the list of targets, if any. DataError names the file and token that is wrong."""
    owner, categories, count = _read_instances(paths, read)
    table = _read_table(paths["sample_annotation"], owner, keyframes, read)
    instance = table.instance
    _require_single(paths["sample_annotation"], table)
    require_counts(paths["instance"], owner, count, instance, paths["sample_annotation"])
    listed = np.zeros(len(instance), dtype=bool)
    if prediction is not None:
        key = instance * len(keyframes.token) + table.sample
        listed = np.isin(key, _read_targets(prediction, owner, keyframes, key))
    class_of = np.array([class_index(name) for name in categories], dtype=np.int64)
    beside = np.array([name in NEUTRAL_OF for name in categories], dtype=bool)
    used = np.flatnonzero(class_of[instance] >= 0)
    row = used[np.argsort(table.sample[used], kind="stable")]
    return Annotations(
        sample=table.sample[row],
        instance=instance[row],
        box=table.box[row],
        class_id=class_of[instance[row]],
        neutral=beside[instance[row]] | table.hidden[row],
        listed=listed[row],
        token=owner,
        boxes=len(instance),
    )


def _read_instances(paths: Mapping[str, Path], read: Read) -> tuple[list[str], list[str], Ints]:
    """Token, category and number of boxes of each instance."""
    categories = {token: text(paths["category"], record, "name") for token, record in by_token(paths["category"], read)}
    path, tokens, category, count = paths["instance"], list[str](), list[str](), array("q")
    for token, record in by_token(path, read):
        tokens.append(token)
        category.append(known(categories, record, path, "category"))
        count.append(whole(path, record, "nbr_annotations"))
    return tokens, category, ints(count)


def _read_table(path: Path, instances: list[str], keyframes: Keyframes, read: Read) -> _Table:
    row = {token: at for at, token in enumerate(instances)}
    tokens, instance, sample, hidden = list[str](), array("q"), array("q"), array("b")
    translation, size, rotation = array("d"), array("d"), array("d")
    for token, record in by_token(path, read):
        tokens.append(token)
        sample.append(known(keyframes.row, record, path, "sample"))
        instance.append(known(row, record, path, "instance"))
        add_numbers(path, record, "translation", 3, translation)
        add_numbers(path, record, "size", 3, size)
        add_numbers(path, record, "rotation", 4, rotation)
        hidden.append(_is_hidden(path, record))
    fields = {"translation": floats(translation, 3), "size": floats(size, 3), "rotation": floats(rotation, 4)}
    check(path, tokens, fields)
    return _Table(tokens, ints(sample), ints(instance), upright_boxes(**fields), np.array(hidden, dtype=bool))


def _is_hidden(path: Path, record: Record) -> bool:
    """Whether a box is known to hold no point: tables of other makers may not count points."""
    counts = [whole(path, record, key) for key in _POINTS if key in record]
    return len(counts) == len(_POINTS) and not any(counts)


def _require_single(path: Path, table: _Table) -> None:
    """An instance has one box in a sample."""
    order = np.lexsort((table.sample, table.instance))
    same = (np.diff(table.instance[order]) == 0) & (np.diff(table.sample[order]) == 0)
    if same.any():
        at = int(np.argmax(same))
        first, second = (table.token[int(row)] for row in order[at : at + 2])
        raise DataError(f"{path}, record {second!r}: a second box of its instance in its sample, beside {first!r}")


def _read_targets(path: Path, instances: list[str], keyframes: Keyframes, known: Ints) -> Ints:
    """Keys (instance x samples + sample) of the targets in scenes of these tables; ``known``: keys of all boxes."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise DataError(f"{path}: expected an object with a list of targets for each scene")
    instance_row = {token: at for at, token in enumerate(instances)}
    keys: list[int] = []
    entries: list[str] = []
    for index, scene in enumerate(keyframes.scene):
        if not isinstance(content.get(scene, []), list):
            raise DataError(f"{path}, {scene}: expected a list of targets")
        own = range(keyframes.start[index], keyframes.start[index + 1])
        for entry in content.get(scene, []):
            instance, _, sample = entry.partition("_") if isinstance(entry, str) else ("", "", "")
            if instance not in instance_row or keyframes.row.get(sample, -1) not in own:
                which = "instance" if instance not in instance_row else "sample"
                raise DataError(f"{path}, {scene}, entry {brief(entry)}: the tables have no such {which} in this scene")
            keys.append(instance_row[instance] * len(keyframes.token) + keyframes.row[sample])
            entries.append(entry)
    key = np.array(keys, dtype=np.int64)
    lost = ~np.isin(key, known)
    if lost.any():
        raise DataError(f"{path}, entry {entries[int(np.argmax(lost))]!r}: the instance has no box in this sample")
    return key
