"""Fields of a record of a table, checked; every error names the file and the record's token."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from ...types import Bools, Floats, Ints
from .json_stream import Record, brief

LIMIT = 1e9  # of any number: far beyond metres, counts and scores, and small enough to be squared
LAST_TIME = 2.0**53  # microseconds; a float holds every whole number up to this one
LONGEST = 100.0  # m, side of a box
NORM_TOLERANCE = 1e-2  # of a quaternion; smaller deviations are rounding and are normalised
MOST_TILTED = 0.05  # share of boxes: a detector may be wrong about some
_NUMBERS = frozenset((int, float))  # types; True and False are of neither


def text(path: Path, record: Record, key: str) -> str:
    """A text."""
    value = record.get(key)
    if type(value) is not str:
        raise DataError(f"{path}, {named(record)}: {key} is {brief(value)}, expected a text")
    return value


def time_stamp(path: Path, record: Record, key: str) -> float:
    """A time in microseconds."""
    value = record.get(key)
    if (type(value) is not int and type(value) is not float) or not 0 <= value <= LAST_TIME:
        raise DataError(f"{path}, {named(record)}: {key} is {brief(value)}, expected a time in microseconds")
    return value


def whole(path: Path, record: Record, key: str) -> int:
    """A whole number."""
    value = record.get(key)
    if type(value) is not int or abs(value) > LIMIT:
        raise DataError(f"{path}, {named(record)}: {key} is {brief(value)}, expected a whole number up to {LIMIT:g}")
    return value


def add_numbers(path: Path, record: Record, key: str, count: int, to: array[float]) -> None:
    """Append the ``count`` numbers of the list ``record[key]`` to ``to``, possibly too large.

    ``path`` names the file in errors.
    """
    value = record.get(key)
    if not extended(to, value, count):
        raise DataError(f"{path}, {named(record)}: {key} is {brief(value)}, expected {count} numbers up to {LIMIT:g}")


def extended(to: array[float], value: Any, count: int) -> bool:
    """Append a list of ``count`` numbers; False for anything else."""
    if type(value) is not list or len(value) != count or not _NUMBERS.issuperset(map(type, value)):
        return False
    to.extend(value)
    return True


def named(record: Record) -> str:
    """The record for messages."""
    token = record.get("token") or record.get("sample_token")
    return f"record {token!r}" if token else f"a record without a token: {brief(record)}"


def floats(values: array[float], columns: int) -> Floats:
    """The values as ``[R, columns]``."""
    return np.frombuffer(values, dtype=np.float64).reshape(-1, columns) if values else np.zeros((0, columns))


def ints(values: array[int]) -> Ints:
    """The values ``[R]``."""
    return np.array(values, dtype=np.int64)


def first_wrong(key: str, value: Floats) -> tuple[int, str] | None:
    """The first of the rows ``[R, n]`` of a field that cannot be, and what is wrong with it; None where all can."""
    for bad, expected in _wrong(key, value):
        if bad.any():
            at = int(np.argmax(bad))
            return at, f"{key} is {shown(value[at])}, expected {expected}"
    return None


def check(path: Path, tokens: Sequence[str], fields: Mapping[str, Floats]) -> None:
    """Raise DataError for the first row of a field, by name, that cannot be; ``tokens`` of the rows."""
    for key, value in fields.items():
        if (found := first_wrong(key, value)) is not None:
            raise DataError(f"{path}, record {tokens[found[0]]!r}: {found[1]}")


def _wrong(key: str, value: Floats) -> Iterator[tuple[Bools, str]]:
    """Which rows cannot be ``[R]``, and what is expected of them, one rule after the other."""
    within = (np.abs(value) <= LIMIT).all(axis=tuple(range(1, value.ndim)))
    yield np.asarray(~within), f"finite numbers up to {LIMIT:g}"
    if key == "size":
        yield np.asarray(~((value > 0) & (value <= LONGEST)).all(axis=1)), f"sizes above 0 and up to {LONGEST:g} m"
    if key == "rotation":
        yield np.abs(np.linalg.norm(value, axis=1) - 1.0) > NORM_TOLERANCE, "a unit quaternion"


def first_tilted(rotation: Floats) -> tuple[int, str] | None:
    """As `first_wrong`, where many of the boxes' quaternions ``[R, 4]`` tilt by over 45 degrees: w was written last."""
    _, x, y, _ = rotation.T
    tilted = 1.0 - 2.0 * (x * x + y * y) < np.sqrt(0.5)
    if not len(rotation) or tilted.mean() <= MOST_TILTED:
        return None
    at = int(np.argmax(tilted))
    what = f"expected w, x, y, z of a box that stands upright; {tilted.sum()} of {len(rotation)} do not"
    return at, f"rotation is {shown(rotation[at])}, {what}: is w written last?"


def yaw_of(rotation: Floats) -> Floats:
    """Headings ``[R]`` of quaternions ``[R, 4]`` (w, x, y, z): the turned x axis, projected on the ground."""
    w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    return np.asarray(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def upright_boxes(translation: Floats, size: Floats, rotation: Floats) -> Floats:
    """Boxes ``[R, 7]`` x y z yaw l w h of the tables' fields; ``size`` is width, length, height."""
    return np.column_stack([translation, yaw_of(rotation), size[:, [1, 0, 2]]])


def shown(value: Any) -> str:
    """Numbers for messages."""
    return str(np.asarray(value).tolist())
