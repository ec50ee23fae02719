"""Fields of a record of a table, checked; every error names the file and the record's token."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
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
IN_RANGE = f"finite numbers up to {LIMIT:g}"  # for messages
SIZED = f"sizes above 0 and up to {LONGEST:g} m"
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
    """Append the ``count`` numbers of a list, possibly NaN or too large."""
    value = record.get(key)
    if not extended(to, value, count):
        raise DataError(f"{path}, {named(record)}: {key} is {brief(value)}, expected {count} numbers up to {LIMIT:g}")


def extended(to: array[float], value: Any, count: int) -> bool:
    """Append a list of ``count`` numbers; False for anything else, and for whole numbers that no float can hold."""
    if type(value) is not list or len(value) != count or not _NUMBERS.issuperset(map(type, value)):
        return False
    try:
        to.extend(value)
    except OverflowError:
        return False
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


def check_numbers(path: Path, key: str, value: Floats, tokens: Sequence[str]) -> None:
    """Raise DataError for the first row that has a number out of range."""
    bad = out_of_range(value)
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(f"{path}, record {tokens[at]!r}: {key} is {shown(value[at])}, expected {IN_RANGE}")


def check_sizes(path: Path, size: Floats, tokens: Sequence[str]) -> None:
    """Raise DataError for the first box with a side that none can have."""
    bad = not_sized(size)
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(f"{path}, record {tokens[at]!r}: size is {shown(size[at])}, expected {SIZED}")


def check_rotations(path: Path, rotation: Floats, tokens: Sequence[str]) -> None:
    """Raise DataError for the first quaternion that is not a unit one."""
    bad = not_unit(rotation)
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(
            f"{path}, record {tokens[at]!r}: rotation {shown(rotation[at])} has the norm "
            f"{np.linalg.norm(rotation[at]):.4g}, expected a unit quaternion"
        )


def out_of_range(value: Floats) -> Bools:
    """Which of the rows ``[R, ...]`` hold NaN or a number beyond `LIMIT` ``[R]``."""
    return np.asarray(~(np.abs(value) <= LIMIT).all(axis=tuple(range(1, value.ndim))))


def not_sized(size: Floats) -> Bools:
    """Which of the sizes ``[R, 3]`` have a side that is not above 0, or longer than `LONGEST` ``[R]``."""
    return np.asarray(~((size > 0) & (size <= LONGEST)).all(axis=1))


def not_unit(rotation: Floats) -> Bools:
    """Which of the quaternions ``[R, 4]`` have another norm than 1 ``[R]``."""
    return np.asarray(np.abs(np.linalg.norm(rotation, axis=1) - 1.0) > NORM_TOLERANCE)


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
