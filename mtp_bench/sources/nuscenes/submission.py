"""Files in the official submission form, and the detections of a card, cached.

They are of the detection or the tracking task.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...core import Bools, DataError, Detections, Floats, Ints
from ..base import class_ids, detections_by_frame
from ..cache import write_arrays
from ..readers import MAX_WORD_LETTERS
from ..rotation import require_rotations
from ..text import LIMIT, Number, decode, read_json
from .layout import CLASSES, ClassName
from .store import INDEX, CachedFolder, TableStore
from .tables import MAX_SIDE_M, Quaternion, Vector, floats, upright_boxes

# share of boxes: a detector may be wrong about some
MAX_TILTED_SHARE = 0.05

# m; boxes of size 0 or below are skipped
_Side = Annotated[float, msgspec.Meta(ge=-LIMIT, le=MAX_SIDE_M)]


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
    identity: Annotated[str, msgspec.Meta(max_length=MAX_WORD_LETTERS)] | int = (
        msgspec.field(name="tracking_id")
    )


SubmittedBox = DetectedBox | TrackedBox
BoxKind = type[DetectedBox] | type[TrackedBox]


class _File(msgspec.Struct):
    results: dict[str, msgspec.Raw]


@dataclass(frozen=True, eq=False)
class SubmittedBoxes:
    """Boxes of a file, without samples that the tables do not have.

    They are sorted by sample, otherwise in the order of the file.
    """

    samples: int  # number of samples in the file
    example: str  # a token of the file
    covered: Ints  # [n] rows of the tables' samples that the file has, sorted
    sample: Ints  # [R] row of the sample
    box: Floats  # [R, 7] global frame
    velocity: Floats  # [R, 2] m/s, NaN if unknown: not given, NaN, or exactly 0
    class_id: Ints  # [R] index into CLASSES
    score: Floats  # [R]
    identity: NDArray[np.str_]  # [R] tracking_id; empty texts in the detection task


def read_submission(
    path: Path, row_of_token: Mapping[str, int], kind: BoxKind = DetectedBox
) -> SubmittedBoxes:
    """Read boxes of the samples in ``row_of_token``.

    Others are left out. Raises DataError that names the file, the sample token and the
    place of the box that is wrong.
    """
    results = read_json(path, _File).results
    covered: list[int] = []
    boxes: list[SubmittedBox] = []
    for token, content in results.items():
        if token in row_of_token:
            covered.append(row_of_token[token])
            boxes += _sample_boxes(path, token, content, kind)
    sample = np.array([row_of_token[box.sample_token] for box in boxes], dtype=np.int64)
    rotation = floats([box.rotation for box in boxes], 4)
    _require_upright(path, boxes, rotation)
    velocity = floats([box.velocity or (np.nan, np.nan) for box in boxes], 2)
    is_unknown = np.isnan(velocity).any(axis=1) | (velocity == 0).all(axis=1)
    velocity[is_unknown] = np.nan
    identity = np.array([str(box.identity) for box in boxes], dtype=np.str_)
    sample_order = np.argsort(sample, kind="stable")
    return SubmittedBoxes(
        samples=len(results),
        example=next(iter(results), ""),
        covered=np.sort(np.array(covered, dtype=np.int64)),
        sample=sample[sample_order],
        box=upright_boxes(boxes, rotation)[sample_order],
        velocity=velocity[sample_order],
        class_id=class_ids([box.name for box in boxes], CLASSES)[sample_order],
        score=floats([box.score for box in boxes], 1)[sample_order, 0],
        identity=identity[sample_order],
    )


def no_match(path: Path, samples: int, example: str, version: str, content: str) -> str:
    """Return the message that no sample of a file is in the tables.

    ``samples``: their number in the file; ``content`` of the file, in words.
    """
    tokens = f"{samples} sample tokens"
    if example:
        tokens += f" (for example {example!r})"
    problem = f"none of its {tokens} is in sample.json of {version}"
    return f"{path}: {problem}; expected {content} of these scenes"


def _sample_boxes(
    path: Path, token: str, content: msgspec.Raw, kind: BoxKind
) -> Sequence[SubmittedBox]:
    where = f"{path}, sample {token!r}"
    try:
        boxes: list[SubmittedBox] = decode(
            content,
            list[kind],  # type: ignore[valid-type]
            where,
        )
    except DataError as error:
        raise DataError(
            f"{error}; expected a submission to the {kind.task} task"
        ) from None
    for place, box in enumerate(boxes):
        if box.sample_token != token:
            raise DataError(
                f"{where}, box {place}: sample_token is {box.sample_token!r}"
            )
    return boxes


def _require_upright(
    path: Path, boxes: Sequence[SubmittedBox], rotation: Floats
) -> None:
    """Raise DataError for rotations that are not unit quaternions, or many tilted."""

    def where(row: int) -> str:
        return f"{path}, sample {boxes[row].sample_token!r}"

    require_rotations(rotation, where)
    _, x, y, _ = rotation.T
    cos_tilt = 1.0 - 2.0 * (x * x + y * y)
    is_tilted = cos_tilt < np.sqrt(0.5)  # by over 45 degrees
    if is_tilted.sum() > MAX_TILTED_SHARE * len(boxes):
        row = int(np.argmax(is_tilted))
        raise DataError(
            f"{where(row)}: rotation is {rotation[row].tolist()}, expected w, x, y, z "
            f"of a box that stands upright; {is_tilted.sum()} of {len(boxes)} do not: "
            "is w written last?"
        )


@dataclass(frozen=True, eq=False)
class DetectionStore:
    """A detection file and its cache, which has the boxes of samples in the tables."""

    path: Path
    cache: CachedFolder
    covered: Bools  # [N] samples of the tables that the file has

    @classmethod
    def open(cls, path: Path, tables: TableStore) -> "DetectionStore":
        """Open a file, which is read first if it is not in the cache."""
        fill = partial(_fill_detections, path, tables)
        cache = CachedFolder.of(tables.cache.path.name, {"detections": path}, fill)
        return cls(path, cache, cache.read(INDEX)["covered"])


def open_detections(
    paths: Sequence[Path], tables: TableStore, names: Sequence[str]
) -> tuple[DetectionStore, ...]:
    """Open files, the smallest first, until they cover the scenes ``names``.

    A file is read whole once, and cached. Raises DataError for an invalid file, naming
    the sample token, if no file has samples of these tables, and unless each frame of
    the scenes is in exactly one of the files.
    """
    required = np.concatenate([np.array(tables.samples(name)) for name in names])
    stores: list[DetectionStore] = []
    file_count = np.zeros(tables.start[-1], dtype=np.int64)  # [N] that have the sample
    for path in sorted(paths, key=lambda path: (path.stat().st_size, path)):
        if not file_count[required].all():
            store = DetectionStore.open(path, tables)
            stores.append(store)
            file_count += store.covered
    if not stores:
        return ()
    if not file_count.any():
        problems: list[str] = []
        for store in stores:
            index = store.cache.read(INDEX)
            samples = int(index["samples"])
            example = str(index["example"])
            problems.append(
                no_match(store.path, samples, example, tables.version, "detections")
            )
        raise DataError("; ".join(problems))
    wrong_rows = required[file_count[required] != 1]
    if len(wrong_rows):
        covered = [file_count[tables.samples(name)].all() for name in names]
        coverage = f"{sum(map(bool, covered))} of the {len(names)} scenes"
        raise DataError(_coverage_problem(stores, tables, wrong_rows[0], coverage))
    return tuple(stores)


def _coverage_problem(
    stores: Sequence[DetectionStore], tables: TableStore, row: int, coverage: str
) -> str:
    """Return the message about a sample that is in two files or in none."""
    scene = tables.scenes[int(np.searchsorted(tables.start, row, side="right")) - 1]
    sample = f"sample {tables.tokens.item(row).decode()!r} of {scene}"
    holders = sorted(str(store.path) for store in stores if store.covered[row])
    if holders:
        advice = "name one of them with --detections"
        return f"{' and '.join(holders)} both have {sample}; {advice}"
    files = ", ".join(str(store.path) for store in stores)
    advice = "choose another split with --split or split="
    return f"{files}: no entry for {sample}: detections cover {coverage}; {advice}"


def scene_detections(
    stores: Sequence[DetectionStore], samples: range, name: str, classes: Sequence[str]
) -> Detections:
    """Return the detections of the scene ``name`` from all files.

    ``samples``: its rows in the tables. Other classes are dropped.
    """
    file_parts = [
        store.cache.read(name) for store in stores if store.covered[samples].any()
    ]
    arrays = {
        key: np.concatenate([part[key] for part in file_parts]) for key in file_parts[0]
    }
    class_id = class_ids(CLASSES, classes)[arrays["class_id"]]
    is_used = class_id >= 0
    return detections_by_frame(
        len(samples),
        arrays["frame"][is_used],
        arrays["box"][is_used],
        class_id[is_used],
        arrays["score"][is_used],
        arrays["velocity"][is_used],
    )


def _fill_detections(path: Path, tables: TableStore, folder: Path) -> None:
    boxes = read_submission(path, tables.row_of_token)
    covered = np.isin(np.arange(tables.start[-1]), boxes.covered)
    for name in tables.scenes:
        samples = tables.samples(name)
        if not covered[samples].any():
            continue
        rows = tables.rows_of(name, boxes.sample)
        arrays = {
            "frame": boxes.sample[rows] - samples.start,
            "box": boxes.box[rows],
            "velocity": boxes.velocity[rows],
            "class_id": boxes.class_id[rows],
            "score": boxes.score[rows],
        }
        write_arrays(folder / f"{name}.npz", arrays)
    index = {
        "covered": covered,
        "samples": np.array(boxes.samples),
        "example": np.array(boxes.example),
    }
    write_arrays(folder / f"{INDEX}.npz", index)
