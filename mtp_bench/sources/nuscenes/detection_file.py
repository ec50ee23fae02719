"""A detection file in the official submission form, read into arrays."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...types import Floats, Ints
from ..text import MOST_LETTERS
from .classes import CLASSES
from .fields import LIMIT, extended, first_tilted, first_wrong, floats, ints, upright_boxes
from .json_stream import Read, brief, read_entries

_CLASS_INDEX = {name: index for index, name in enumerate(CLASSES)}
_COUNTS = {"translation": 3, "size": 3, "rotation": 4, "velocity": 2}


@dataclass(frozen=True)
class Form:
    """A submission form: that of a task, whose boxes have ``<task>_name`` and ``<task>_score``."""

    task: str
    other: str  # the task whose file may be taken for one of this form
    identified: bool = False  # its boxes have a tracking_id

    @property
    def of_other(self) -> str:
        """What is wrong with a box of the other task."""
        return (
            f"it has a {self.other}_name: the file is a submission to the {self.other} task; expected one to the "
            f"{self.task} task, whose boxes have {self.task}_name and {self.task}_score"
        )


DETECTION = Form("detection", "tracking")
TRACKING = Form("tracking", "detection", identified=True)


@dataclass(frozen=True, eq=False)
class DetectedBoxes:
    """Boxes of those samples of a file that the tables have, sorted by sample, otherwise in the order of the file."""

    samples: int  # in the file
    example: str  # a token of the file
    covered: Ints  # [n] rows of the tables' samples that the file has, sorted
    sample: Ints  # [R] row of the sample
    box: Floats  # [R, 7] global frame
    velocity: Floats  # [R, 2] m/s, NaN where unknown: not given, NaN, or exactly 0
    class_id: Ints  # [R] index into CLASSES
    score: Floats  # [R]
    identity: NDArray[np.str_]  # [R] tracking_id; empty texts where the form has none


def read_detections(path: Path, row: Mapping[str, int], read: Read, form: Form = DETECTION) -> DetectedBoxes:
    """Boxes of the samples in ``row`` (token to row); other samples of the file are left out.

    Raises DataError that names the file, the sample token and the place of the box that is wrong.
    """
    rows = _Rows(path, form)
    seen: dict[str, int] = {}
    count, example = 0, ""
    for token, boxes in read_entries(path, "results", read):
        count, example = count + 1, example or token
        if token not in row:
            continue
        if token in seen:
            raise DataError(f"{path}, sample {token!r}: a second list of boxes, expected one")
        seen[token] = row[token]
        rows.add(token, boxes)
    sample = np.array([row[token] for token in rows.tokens], dtype=np.int64)[ints(rows.entry)]
    fields = {key: floats(rows.numbers[key], count) for key, count in _COUNTS.items()}
    score = floats(rows.score, 1)[:, 0]
    for key, value in {**fields, f"{form.task}_score": score}.items():
        rows.refuse_first(first_wrong(key, value))
    rows.refuse_first(first_tilted(fields["rotation"]))
    velocity = fields.pop("velocity")
    unknown = (velocity == 0).all(axis=1)
    order = np.argsort(sample, kind="stable")
    return DetectedBoxes(
        samples=count,
        example=example,
        covered=np.array(sorted(seen.values()), dtype=np.int64),
        sample=sample[order],
        box=upright_boxes(**fields)[order],
        velocity=np.where(unknown[:, None], np.nan, velocity)[order],
        class_id=ints(rows.class_id)[order],
        score=score[order],
        identity=np.array(rows.identity, dtype=np.str_)[order],
    )


def no_match(path: Path, samples: int, example: str, version: str, what: str) -> str:
    """What is wrong with a file of ``what`` whose ``samples`` are none of the tables of ``version``."""
    such = f" (for example {example!r})" if example else ""
    return (
        f"{path}: none of its {samples} sample tokens{such} is in sample.json of {version}; expected {what} of these "
        "scenes"
    )


class _Rows:
    """The boxes in the order of the file."""

    def __init__(self, path: Path, form: Form) -> None:
        self.path, self.form = path, form
        self.identity: list[str] = []
        self.tokens: list[str] = []  # of the samples that were added
        self.entry, self.place = array("q"), array("q")  # of each box: index into tokens, place in its list
        self.class_id, self.score = array("q"), array("d")
        self.numbers = {key: array("d") for key in _COUNTS}

    def add(self, token: str, boxes: Any) -> None:
        """Append the boxes of a sample."""
        if not isinstance(boxes, list):
            raise DataError(f"{self.path}, sample {token!r}: got {brief(boxes)!r}, expected a list of boxes")
        entry = len(self.tokens)
        self.tokens.append(token)
        for place, box in enumerate(boxes):
            self.entry.append(entry)
            self.place.append(place)
            if not isinstance(box, dict):
                self._refuse(entry, place, f"got {brief(box)!r}, expected a box")
            if box.get("sample_token") != token:
                self._refuse(entry, place, f"sample_token is {brief(box.get('sample_token'))}, expected {token!r}")
            self._add(entry, place, box)

    def _add(self, entry: int, place: int, box: dict[str, Any]) -> None:
        task = self.form.task
        name, score = box.get(f"{task}_name"), box.get(f"{task}_score")
        if name is None and f"{self.form.other}_name" in box:
            self._refuse(entry, place, self.form.of_other)
        if not isinstance(name, str) or name not in _CLASS_INDEX:
            self._refuse(entry, place, f"{task}_name is {brief(name)}, expected one of {', '.join(CLASSES)}")
        if not extended(self.score, [score], 1):
            self._refuse(entry, place, f"{task}_score is {brief(score)}, expected a number up to {LIMIT:g}")
        self._identify(entry, place, box)
        self.class_id.append(_CLASS_INDEX[name])
        for key, count in _COUNTS.items():
            value = box.get(key)
            if key == "velocity" and (value is None or (isinstance(value, list) and None in value)):
                value = [0.0, 0.0]  # unknown
            if not extended(self.numbers[key], value, count):
                self._refuse(entry, place, f"{key} is {brief(value)}, expected {count} numbers up to {LIMIT:g}")

    def _identify(self, entry: int, place: int, box: dict[str, Any]) -> None:
        identity = box.get("tracking_id") if self.form.identified else ""
        if isinstance(identity, bool) or not isinstance(identity, str | int):
            self._refuse(entry, place, f"tracking_id is {brief(identity)}, expected a text")
        if len(str(identity)) > MOST_LETTERS:
            self._refuse(entry, place, f"tracking_id is {brief(identity)}, expected at most {MOST_LETTERS} characters")
        self.identity.append(str(identity))

    def refuse_first(self, wrong: tuple[int, str] | None) -> None:
        """Raise DataError for the box at this place of all, and what is wrong with it."""
        if wrong is not None:
            at, what = wrong
            self._refuse(self.entry[at], self.place[at], what)

    def _refuse(self, entry: int, place: int, what: str) -> NoReturn:
        raise DataError(f"{self.path}, sample {self.tokens[entry]!r}, box {place}: {what}")
