"""Readers of the WILDTRACK files: annotations and MVDet's stored detections."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from ...types import Floats, Ints
from ..text import LIMIT, Table, read_json, read_table

GRID = 480, 1440  # cells of the annotated area along x and y
CELL = 0.025  # m
CORNER = -3.0, -9.0  # m, x and y of cell (0, 0)


@dataclass(frozen=True, eq=False)
class Annotations:
    """People of one frame, in the order of the file."""

    person: Ints  # [M]
    place: Floats  # [M, 2] m on the ground plane


@dataclass(frozen=True, eq=False)
class StoredDetections:
    """Rows of a file ``frame gx gy``."""

    table: Table
    frame: Ints  # [R] the number of the annotation file
    place: Floats  # [R, 2] m on the ground plane


def read_annotations(path: Path) -> Annotations:
    """People of one frame; DataError names the file and the person that is wrong."""
    content = read_json(path)
    if not isinstance(content, list):
        raise DataError(f"{path}: got {type(content).__name__}, expected a list of people")
    person, place = [], []
    for number, entry in enumerate(content):
        where = f"{path}, entry {number}"
        person.append(_integer(entry, "personID", where))
        where = f"{path}, person {person[-1]}"
        place.append(_place(_integer(entry, "positionID", where), where))
    ids = np.array(person, dtype=np.int64)
    known, count = np.unique(ids, return_counts=True)
    if (count > 1).any():
        raise DataError(f"{path}: person {known[np.argmax(count > 1)]} is there twice, expected once per frame")
    return Annotations(ids, np.reshape(place, (-1, 2)))


def read_detections(path: Path) -> StoredDetections:
    """Detections, rows ``frame gx gy`` on the grid of the annotations; DataError names the line that is wrong."""
    table = read_table(path, "frame gx gy")
    frame, cell = table.whole("frame"), table.value[:, 1:]
    off = np.asarray(~((cell >= 0) & (cell < GRID)).all(axis=1))  # NaN is off the grid, too
    table.refuse(off, lambda at: f"cell {cell[at, 0]:g} {cell[at, 1]:g} is off the grid of {GRID[0]} x {GRID[1]}")
    _, first, place = np.unique(table.value, axis=0, return_index=True, return_inverse=True)
    original = first[place.reshape(-1)]
    table.refuse(
        original < np.arange(len(original)),
        lambda at: f"a second detection at the place of line {table.line[original[at]]}",
    )
    return StoredDetections(table, frame, metres(cell))


def metres(cell: Floats | Ints) -> Floats:
    """Places ``[..., 2]`` in metres of grid cells ``[..., 2]``."""
    return np.asarray(np.array(CORNER) + CELL * cell)


def _place(position: int, where: str) -> Floats:
    if not 0 <= position < GRID[0] * GRID[1]:
        raise DataError(f"{where}: positionID is {position}, off the grid of {GRID[0]} x {GRID[1]} cells")
    return metres(np.array([position % GRID[0], position // GRID[0]]))


def _integer(entry: Any, key: str, where: str) -> int:
    if not isinstance(entry, dict):
        raise DataError(f"{where}: got {reprlib.repr(entry)}, expected an object with {key!r}")
    value = entry.get(key)
    if key not in entry:
        raise DataError(f"{where}: no {key!r}")
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > LIMIT:
        raise DataError(f"{where}: {key!r} is {reprlib.repr(value)}, expected an integer up to {LIMIT:g}")
    return value
