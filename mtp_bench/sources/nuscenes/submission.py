"""Files in the official submission form of the detection or the tracking task, and the detections of a card, cached."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...core import Bools, DataError, Detections, Floats, Ints, starts_of_sorted
from ..base import class_ids
from ..cache import write_arrays
from ..text import LIMIT, MOST_LETTERS, decode, read_json
from .layout import CLASSES, ClassName
from .store import INDEX, CachedFolder, TableStore
from .tables import (
    LONGEST,
    Number,
    Quaternion,
    Vector,
    floats,
    require_rotations,
    upright_boxes,
)

MOST_TILTED = 0.05  # share of boxes: a detector may be wrong about some
_CLASS_INDEX = {name: index for index, name in enumerate(CLASSES)}


_Side = Annotated[
    float, msgspec.Meta(ge=-LIMIT, le=LONGEST)
]  # m; boxes of size 0 or below are skipped


class _Box(msgspec.Struct, gc=False):
    sample_token: str
    translation: Vector
    size: tuple[_Side, _Side, _Side]
    rotation: Quaternion
    velocity: tuple[Number | None, Number | None] | None = None


class DetectedBox(_Box, gc=False, kw_only=True):
    """A box of a submission to the detection task."""

    task: ClassVar = "detection"
    name: ClassName = msgspec.field(name="detection_name")
    score: Number = msgspec.field(name="detection_score")
    identity: str = ""


class TrackedBox(_Box, gc=False, kw_only=True):
    """A box of a submission to the tracking task."""

    task: ClassVar = "tracking"
    name: ClassName = msgspec.field(name="tracking_name")
    score: Number = msgspec.field(name="tracking_score")
    identity: Annotated[str, msgspec.Meta(max_length=MOST_LETTERS)] | int = (
        msgspec.field(name="tracking_id")
    )


BoxKind = type[DetectedBox] | type[TrackedBox]


class _File(msgspec.Struct):
    results: dict[str, msgspec.Raw]


@dataclass(frozen=True, eq=False)
class SubmittedBoxes:
    """Boxes of those samples of a file that the tables have, sorted by sample, otherwise in the order of the file."""

    samples: int  # in the file
    example: str  # a token of the file
    covered: Ints  # [n] rows of the tables' samples that the file has, sorted
    sample: Ints  # [R] row of the sample
    box: Floats  # [R, 7] global frame
    velocity: Floats  # [R, 2] m/s, NaN if unknown: not given, NaN, or exactly 0
    class_id: Ints  # [R] index into CLASSES
    score: Floats  # [R]
    identity: NDArray[np.str_]  # [R] tracking_id; empty texts in the detection task


def read_submission(
    path: Path, row: Mapping[str, int], kind: BoxKind = DetectedBox
) -> SubmittedBoxes:
    """Boxes of the samples in ``row`` (token to row); other samples of the file are left out.

    Raises DataError that names the file, the sample token and the place of the box that is wrong.
    """
    results = read_json(path, _File).results
    covered = [token for token in results if token in row]
    boxes: list[DetectedBox | TrackedBox] = []
    for token in covered:
        boxes += _sample_boxes(path, token, results[token], kind)
    sample = np.array([row[box.sample_token] for box in boxes], dtype=np.int64)
    rotation = floats([box.rotation for box in boxes], 4)
    _require_upright(path, boxes, rotation)
    velocity = floats([box.velocity or (np.nan, np.nan) for box in boxes], 2)
    velocity[np.isnan(velocity).any(axis=1) | (velocity == 0).all(axis=1)] = np.nan
    order = np.argsort(sample, kind="stable")
    return SubmittedBoxes(
        samples=len(results),
        example=next(iter(results), ""),
        covered=np.sort(np.array([row[token] for token in covered], dtype=np.int64)),
        sample=sample[order],
        box=upright_boxes(boxes, rotation)[order],
        velocity=velocity[order],
        class_id=np.array([_CLASS_INDEX[box.name] for box in boxes], dtype=np.int64)[
            order
        ],
        score=floats([box.score for box in boxes], 1)[order, 0],
        identity=np.array([str(box.identity) for box in boxes], dtype=np.str_)[order],
    )


def no_match(path: Path, samples: int, example: str, version: str, what: str) -> str:
    """Message that a file of ``what`` has ``samples`` samples, and none of them is in the tables of ``version``."""
    tokens = f"{samples} sample tokens" + (
        f" (for example {example!r})" if example else ""
    )
    return f"{path}: none of its {tokens} is in sample.json of {version}; expected {what} of these scenes"


def _sample_boxes(
    path: Path, token: str, content: msgspec.Raw, kind: BoxKind
) -> Sequence[DetectedBox | TrackedBox]:
    try:
        kinds = list[kind]  # type: ignore[valid-type]
        boxes: list[DetectedBox | TrackedBox] = decode(
            content, kinds, f"{path}, sample {token!r}"
        )
    except DataError as error:
        raise DataError(
            f"{error}; expected a submission to the {kind.task} task"
        ) from None
    for place, box in enumerate(boxes):
        if box.sample_token != token:
            raise DataError(
                f"{path}, sample {token!r}, box {place}: sample_token is {box.sample_token!r}"
            )
    return boxes


def _require_upright(
    path: Path, boxes: Sequence[DetectedBox | TrackedBox], rotation: Floats
) -> None:
    """Raise DataError for a rotation that is not a unit quaternion, and if many boxes do not stand upright."""

    def where(row: int) -> str:
        return f"{path}, sample {boxes[row].sample_token!r}"

    require_rotations(rotation, where)
    _, x, y, _ = rotation.T
    tilted = 1.0 - 2.0 * (x * x + y * y) < np.sqrt(0.5)  # by over 45 degrees
    if len(boxes) and tilted.mean() > MOST_TILTED:
        row = int(np.argmax(tilted))
        raise DataError(
            f"{where(row)}: rotation is {rotation[row].tolist()}, expected w, x, y, z of a box that stands upright; "
            f"{tilted.sum()} of {len(boxes)} do not: is w written last?"
        )


@dataclass(frozen=True, eq=False)
class DetectionStore:
    """A detection file and its cache, which holds the boxes of samples in the tables."""

    path: Path
    cache: CachedFolder
    covered: Bools  # [N] samples of the tables that the file has


def open_detections(
    paths: Sequence[Path], tables: TableStore, names: Sequence[str]
) -> tuple[DetectionStore, ...]:
    """Open files, the smallest first, until they cover the scenes ``names``; a file is read whole once, and cached.

    Raises DataError for an invalid file, naming the sample token, if no file has samples of these tables, and unless
    each frame of the scenes is in exactly one of the files.
    """
    wanted = np.concatenate([np.array(tables.samples(name)) for name in names])
    stores: list[DetectionStore] = []
    files = np.zeros(tables.start[-1], dtype=np.int64)  # [N] that have the sample
    for path in sorted(paths, key=lambda path: (path.stat().st_size, path)):
        if not files[wanted].all():
            stores.append(_open(path, tables))
            files += stores[-1].covered
    if not stores:
        return ()
    if not files.any():
        every = [(store.path, store.cache.read(INDEX)) for store in stores]
        told = [
            no_match(
                path, int(i["samples"]), str(i["example"]), tables.version, "detections"
            )
            for path, i in every
        ]
        raise DataError("; ".join(told))
    wrong = wanted[files[wanted] != 1]
    if len(wrong):
        holders = sorted(str(store.path) for store in stores if store.covered[wrong[0]])
        scene = tables.scenes[
            int(np.searchsorted(tables.start, wrong[0], side="right")) - 1
        ]
        sample = f"sample {tables.tokens.item(wrong[0]).decode()!r} of {scene}"
        if holders:
            raise DataError(
                f"{' and '.join(holders)} both have {sample}; name one of them with --detections"
            )
        covered = sum(bool(files[tables.samples(name)].all()) for name in names)
        raise DataError(
            f"{', '.join(str(store.path) for store in stores)}: no entry for {sample}: detections cover {covered} of "
            f"the {len(names)} scenes; choose another split with --split or split="
        )
    return tuple(stores)


def scene_detections(
    stores: Sequence[DetectionStore], samples: range, name: str, classes: Sequence[str]
) -> Detections:
    """Detections of the scene ``name`` (rows ``samples`` of the tables) from all files; other classes are dropped."""
    parts = [store.cache.read(name) for store in stores if store.covered[samples].any()]
    frame, box, velocity, score, kind = (
        np.concatenate([part[key] for part in parts])
        for key in ("frame", "box", "velocity", "score", "class_id")
    )
    class_id = class_ids(CLASSES, classes)[kind]
    used = np.flatnonzero(class_id >= 0)
    row = used[np.argsort(frame[used], kind="stable")]
    start = starts_of_sorted(frame[row], len(samples))
    return Detections(start, box[row], velocity[row], class_id[row], score[row])


def _open(path: Path, tables: TableStore) -> DetectionStore:
    cache = CachedFolder.of(
        tables.cache.path.name, {"detections": path}, partial(_fill, path, tables)
    )
    return DetectionStore(path, cache, cache.read(INDEX)["covered"])


def _fill(path: Path, tables: TableStore, folder: Path) -> None:
    boxes = read_submission(path, tables.row_of_token)
    covered = np.isin(np.arange(tables.start[-1]), boxes.covered)
    for name in tables.scenes:
        samples = tables.samples(name)
        if covered[samples].any():
            row = slice(*np.searchsorted(boxes.sample, [samples.start, samples.stop]))
            arrays = {
                "frame": boxes.sample[row] - samples.start,
                "box": boxes.box[row],
                "velocity": boxes.velocity[row],
                "class_id": boxes.class_id[row],
                "score": boxes.score[row],
            }
            write_arrays(folder / f"{name}.npz", arrays)
    index = {
        "covered": covered,
        "samples": np.array(boxes.samples),
        "example": np.array(boxes.example),
    }
    write_arrays(folder / f"{INDEX}.npz", index)
