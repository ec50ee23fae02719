"""Reading and checking the rows that an online tracker returns."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from reprlib import repr as _short
from typing import Any

import numpy as np

from ..errors import ShapeError
from ..types import Floats

FORM = "(id, box, score) or (id, box, score, detection)"


@dataclass(frozen=True, eq=False)
class TrackRow:
    """One track of a frame."""

    id: Hashable
    box: Floats  # [7], or [4] of a rectangle
    score: float
    detection: int | None  # -1: none was taken; None: not stated


def read_rows(answer: Any, detections: int, frame: int) -> list[TrackRow]:
    """The rows of an answer to ``detections`` boxes.

    Raises ShapeError that names the frame, the row and what is wrong with it; also where an id or a detection occurs
    twice.
    """
    where = f"frame {frame}: the tracker gave"
    if not isinstance(answer, Iterable) or isinstance(answer, str | bytes):
        raise ShapeError(f"{where} {_short(answer)}, expected a list of {FORM}")
    rows = [_row(row, detections, f"{where} {_short(row)} as row {place}:") for place, row in enumerate(answer)]
    ids: set[Hashable] = set()
    taken: set[int] = set()
    for row in rows:
        if row.id in ids:
            raise ShapeError(f"{where} id {row.id!r} twice, expected each id once; leave out what has no id yet")
        if row.detection is not None and row.detection in taken:
            raise ShapeError(f"{where} detection {row.detection} to two tracks, expected one")
        ids.add(row.id)
        taken |= {row.detection} - {None, -1}  # type: ignore[arg-type]
    return rows


def _row(row: Any, detections: int, where: str) -> TrackRow:
    if not isinstance(row, Sequence) or isinstance(row, str | bytes) or len(row) not in (3, 4):
        raise ShapeError(f"{where} expected {FORM}")
    return TrackRow(
        id=_identity(row[0], where),
        box=_box(row[1], where),
        score=_score(row[2], where),
        detection=_detection(row[3], detections, where) if len(row) == 4 else None,
    )


def _identity(value: Any, where: str) -> Hashable:
    try:
        hash(value)
    except TypeError:
        raise ShapeError(f"{where} the id is a {type(value).__name__}, expected a number or a text") from None
    if value is None or (isinstance(value, float) and np.isnan(value)):
        raise ShapeError(f"{where} the id is {value}, expected a number or a text; leave out what has no id yet")
    return value  # type: ignore[no-any-return]


def _box(value: Any, where: str) -> Floats:
    try:
        box = np.asarray(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError):
        raise ShapeError(f"{where} the box is {_short(value)}, expected 7 numbers or 4") from None
    if len(box) not in (4, 7):
        raise ShapeError(f"{where} the box has {len(box)} numbers, expected x y z yaw l w h, or x1 y1 x2 y2 in pixels")
    if not np.isfinite(box).all():
        raise ShapeError(f"{where} the box is {box.tolist()}, expected finite numbers")
    if len(box) == 7 and not (box[4:] > 0).all():
        raise ShapeError(f"{where} the box has l w h {box[4:].tolist()}, expected sizes above 0")
    return box


def _score(value: Any, where: str) -> float:
    try:
        score = float(value)
    except (TypeError, ValueError):
        score = np.nan
    if not np.isfinite(score):
        raise ShapeError(f"{where} the score is {_short(value)}, expected a finite number")
    return score


def _detection(value: Any, detections: int, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not -1 <= value < detections:
        raise ShapeError(
            f"{where} the detection is {_short(value)}, expected -1 or one of the {detections} rows of the detections"
        )
    return int(value)
