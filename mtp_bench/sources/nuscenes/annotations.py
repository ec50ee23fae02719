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
from .chains import Chains, Rows, Tokens
from .classes import NEUTRAL_OF, class_index
from .fields import add_numbers, check, floats, ints, text, upright_boxes, whole
from .json_stream import Read, brief, read_records
from .tables import Keyframes, by_token


@dataclass(frozen=True, eq=False)
class Annotations:
    """Boxes of the classes of the detection task, neutral ones included, sorted by sample and place in the table."""

    sample: Ints  # [R] row of the keyframe
    instance: Ints  # [R]
    box: Floats  # [R, 7] global frame
    class_id: Ints  # [R] index into CLASSES
    neutral: Bools  # [R]
    listed: Bools  # [R] a target of the prediction challenge
    token: list[str]  # of all instances
    boxes: int  # of all categories


@dataclass(frozen=True, eq=False)
class _Instances:
    tokens: Tokens
    category: list[str]
    first: array[int]
    last: array[int]
    count: array[int]


@dataclass(frozen=True, eq=False)
class _Table:
    """Rows of ``sample_annotation.json``."""

    rows: Rows
    previous: array[int]
    following: array[int]
    sample: Ints
    instance: array[int]
    box: Floats


def read_annotations(
    paths: Mapping[str, Path], prediction: Path | None, keyframes: Keyframes, read: Read
) -> Annotations:
    """Read all boxes; ``prediction``: the list of targets, if any. DataError names the file and token that is wrong."""
    refer = Tokens(paths["sample_annotation"])
    instances = _read_instances(paths, refer, read)
    table = _read_table(paths["sample_annotation"], refer, instances.tokens, keyframes, read)
    path, owner = paths["instance"], instances.tokens.resolve()
    instance = owner.of(table.instance, "instance_token", table.rows.path, table.rows.token)
    _require_single(table, instance)
    _check_chains(path, table, instance, instances, owner, keyframes)
    listed = np.zeros(len(instance), dtype=bool)
    if prediction is not None:
        key = instance * len(keyframes.token) + table.sample
        listed = np.isin(key, _read_targets(prediction, owner.token, keyframes, key))
    class_of = np.array([class_index(name) for name in instances.category], dtype=np.int64)
    beside = np.array([name in NEUTRAL_OF for name in instances.category], dtype=bool)
    used = np.flatnonzero(class_of[instance] >= 0)
    row = used[np.argsort(table.sample[used], kind="stable")]
    return Annotations(
        sample=table.sample[row],
        instance=instance[row],
        box=table.box[row],
        class_id=class_of[instance[row]],
        neutral=beside[instance[row]],
        listed=listed[row],
        token=owner.token,
        boxes=len(instance),
    )


def _read_instances(paths: Mapping[str, Path], annotations: Tokens, read: Read) -> _Instances:
    categories = {token: text(paths["category"], record, "name") for token, record in by_token(paths["category"], read)}
    path = paths["instance"]
    found = _Instances(Tokens(path), [], array("q"), array("q"), array("q"))
    for record in read_records(path, read):
        token = found.tokens.add(record)
        category = text(path, record, "category_token")
        if category not in categories:
            raise DataError(
                f"{path}, record {token!r}: category_token is {category!r}, but category.json has no such record"
            )
        found.category.append(categories[category])
        found.first.append(annotations.refer(text(path, record, "first_annotation_token")))
        found.last.append(annotations.refer(text(path, record, "last_annotation_token")))
        found.count.append(whole(path, record, "nbr_annotations"))
    return found


def _read_table(path: Path, refer: Tokens, instances: Tokens, keyframes: Keyframes, read: Read) -> _Table:
    previous, following, instance, sample = array("q"), array("q"), array("q"), array("q")
    translation, size, rotation = array("d"), array("d"), array("d")
    for record in read_records(path, read):
        token = refer.add(record)
        at = keyframes.row.get(text(path, record, "sample_token"), -1)
        if at < 0:
            raise DataError(
                f"{path}, record {token!r}: sample_token is {record['sample_token']!r}, "
                "but sample.json has no such record"
            )
        sample.append(at)
        instance.append(instances.refer(text(path, record, "instance_token")))
        previous.append(refer.refer(text(path, record, "prev")))
        following.append(refer.refer(text(path, record, "next")))
        add_numbers(path, record, "translation", 3, translation)
        add_numbers(path, record, "size", 3, size)
        add_numbers(path, record, "rotation", 4, rotation)
    rows = refer.resolve()
    fields = {"translation": floats(translation, 3), "size": floats(size, 3), "rotation": floats(rotation, 4)}
    check(path, rows.token, fields)
    return _Table(rows, previous, following, ints(sample), instance, upright_boxes(**fields))


def _require_single(table: _Table, instance: Ints) -> None:
    """An instance has one box in a sample."""
    order = np.lexsort((table.sample, instance))
    same = (np.diff(instance[order]) == 0) & (np.diff(table.sample[order]) == 0)
    if same.any():
        at = int(np.argmax(same))
        first, second = (table.rows.token[int(row)] for row in order[at : at + 2])
        raise DataError(
            f"{table.rows.path}, record {second!r}: a second box of its instance in its sample, beside {first!r}"
        )


def _check_chains(
    path: Path, table: _Table, instance: Ints, instances: _Instances, owner: Rows, keyframes: Keyframes
) -> None:
    """The boxes of an instance follow each other in time, within one scene."""
    rows, own = table.rows, table.rows.path
    chains = Chains(
        rows, rows.of(table.previous, "prev", own, rows.token, none=True),
        rows.of(table.following, "next", own, rows.token, none=True),
        instance, keyframes.time[table.sample], path, "instance", owner.token,
        rows.of(instances.first, "first_annotation_token", path, owner.token),
        rows.of(instances.last, "last_annotation_token", path, owner.token), ints(instances.count),
    )  # fmt: skip
    chains.check()
    scene = keyframes.scene_of[table.sample]
    ahead = chains.following >= 0
    leaves = scene[ahead] != scene[chains.following[ahead]]
    if leaves.any():
        token = rows.token[int(np.flatnonzero(ahead)[np.argmax(leaves)])]
        raise DataError(f"{own}, record {token!r}: broken chain, its 'next' is in another scene")


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
