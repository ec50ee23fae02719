"""Reading and checking the rows that an online tracker returns."""

from collections import Counter
from collections.abc import Hashable, Iterable
from reprlib import repr as _short
from typing import Any, NamedTuple

import numpy as np

from ..errors import ShapeError
from ..types import Floats

FORM = "(id, box, score) or (id, box, score, detection)"
_BOX = "x y z yaw l w h with sizes above 0, or x1 y1 x2 y2 in pixels, all finite"


class TrackRow(NamedTuple):
    """One track of a frame."""

    id: Hashable
    box: Floats  # [7], or [4] of a rectangle
    score: float
    detection: int | None  # -1: none was taken; None: not stated


def read_rows(answer: Any, detections: int, frame: int) -> list[TrackRow]:
    """The rows of an answer to ``detections`` boxes.

    Raises ShapeError that names the frame, the row and what is wrong with it, such as an id or a detection given twice.
    """
    where = f"frame {frame}: the tracker gave"
    if not isinstance(answer, Iterable) or isinstance(answer, str | bytes):
        raise ShapeError(f"{where} {_short(answer)}, expected a list of {FORM}")
    rows = [_row(row, detections, f"{where} {_short(row)} as row {place}:") for place, row in enumerate(answer)]
    for name, count in Counter(row.id for row in rows).items():
        if count > 1:
            raise ShapeError(f"{where} id {name!r} twice, expected each id once; leave out what has no id yet")
    for taken, count in Counter(row.detection for row in rows).items():
        if count > 1 and taken not in (None, -1):
            raise ShapeError(f"{where} detection {taken} to two tracks, expected one")
    return rows


def _row(row: Any, detections: int, where: str) -> TrackRow:
    try:
        name, given, score, *rest = row
        box = np.asarray(given, dtype=np.float64).reshape(-1)
        track = TrackRow(name, box, float(score), *(rest or [None]))
        hash(name)
    except (TypeError, ValueError):
        raise ShapeError(f"{where} expected {FORM}: a number or a text, 7 numbers or 4, a number, a row") from None
    taken, sizes = track.detection, box[4:]
    known = not rest or (isinstance(taken, int | np.integer) and not isinstance(taken, bool))
    wrong = {
        f"the id is {name}, expected a number or a text; leave out what has no id yet": name is None
        or (isinstance(name, float) and np.isnan(name)),
        f"the box is {box.tolist()}, expected {_BOX}": len(box) not in (4, 7)
        or not np.isfinite(box).all()
        or not (sizes > 0).all(),
        f"the score is {track.score}, expected a finite number": not np.isfinite(track.score),
        f"the detection is {_short(taken)}, expected -1 or one of the {detections} rows of the detections": not known
        or not -1 <= (taken if taken is not None else -1) < detections,
    }
    for problem in (text for text, found in wrong.items() if found):
        raise ShapeError(f"{where} {problem}")
    return track
