"""Tables of nuScenes, decoded by msgspec into typed records.

A file is read whole. The most memory is needed for ``sample_data.json`` of the official v1.0-trainval: about 1.2 GB for
its text and 1.1 GB for its 2.6 million records (extrapolated from 300 000). Both are free again before the next table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from ...errors import DataError
from ...types import Floats
from ..text import LIMIT, read_json, refuse

NORM_TOLERANCE = 1e-2  # of a quaternion; smaller deviations are rounding and are normalised

Number = Annotated[float, msgspec.Meta(ge=-LIMIT, le=LIMIT)]
Pair = tuple[Number, Number]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]  # w x y z
_Side = Annotated[float, msgspec.Meta(gt=0, le=100)]  # m
Size = tuple[_Side, _Side, _Side]  # width, length, height

Content = TypeVar("Content")


class TableRecord(msgspec.Struct, gc=False):
    """A record of a table; keys that are not declared are skipped."""

    token: str


RecordT = TypeVar("RecordT", bound=TableRecord)


def read_records(path: Path, kind: type[RecordT]) -> list[RecordT]:
    """All records of a table, in its order."""
    return read_json(path, list[kind])  # type: ignore[valid-type]


def by_token(path: Path, kind: type[RecordT]) -> dict[str, RecordT]:
    """Records of a table by their tokens; raises DataError for a token that two of them share."""
    records = read_records(path, kind)
    table = {record.token: record for record in records}
    if len(table) < len(records):
        token = next(record.token for record in records if table[record.token] is not record)
        raise DataError(f"{path}: several records have the token {token!r}, expected one")
    return table


def find(table: dict[str, Content], record: TableRecord, key: str, path: Path) -> Content:
    """Entry of ``table`` that the token ``key`` of a record of ``path`` names; raises DataError if it is missing."""
    token = getattr(record, key)
    if token not in table:
        name = key.removesuffix("_token")
        raise DataError(f"{path}, record {record.token!r}: {key} is {token!r}, but {name}.json has no such record")
    return table[token]


def floats(rows: Sequence[Any], columns: int) -> Floats:
    """Tuples of ``columns`` numbers as ``[R, columns]``."""
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def require_rotations(rotation: Floats, where: Callable[[int], str]) -> None:
    """Raise DataError for the first row of quaternions ``[R, 4]`` that are not of norm 1; ``where``: name of a row."""
    wrong = np.abs(np.linalg.norm(rotation, axis=1) - 1.0) > NORM_TOLERANCE
    refuse(wrong, lambda row: f"{where(row)}: rotation is {rotation[row].tolist()}, expected a unit quaternion")


def yaw_of(rotation: Floats) -> Floats:
    """Headings ``[R]`` of quaternions ``[R, 4]`` (w, x, y, z): the turned x axis, projected on the ground."""
    w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    return np.asarray(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def upright_boxes(translation: Floats, size: Floats, rotation: Floats) -> Floats:
    """Boxes ``[R, 7]`` x y z yaw l w h of the tables' fields; ``size`` is width, length, height."""
    return np.column_stack([translation, yaw_of(rotation), size[:, [1, 0, 2]]])
