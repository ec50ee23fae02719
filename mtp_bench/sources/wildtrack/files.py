"""Readers of the WILDTRACK files: annotations and MVDet's stored detections."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...errors import DataError
from ...types import Floats, Ints
from ..text import TextTable, read_json, read_table

GRID = 480, 1440  # cells of the annotated area along x and y
CELL = 0.025  # m
CORNER = -3.0, -9.0  # m, x and y of cell (0, 0)


class _Person(msgspec.Struct):
    id: Annotated[int, msgspec.Meta(ge=-(10**9), le=10**9)] = msgspec.field(name="personID")
    position: Annotated[int, msgspec.Meta(ge=0, lt=GRID[0] * GRID[1])] = msgspec.field(name="positionID")  # the cell


@dataclass(frozen=True, eq=False)
class GroundDetections:
    """Rows of a file ``frame gx gy``."""

    table: TextTable
    frame: Ints  # [R] the number of the annotation file
    place: Floats  # [R, 2] m on the ground plane


def read_annotations(path: Path) -> tuple[Ints, Floats]:
    """Ids [M] of the people of one frame and their places [M, 2] on the ground, m; DataError names the wrong person."""
    people = read_json(path, list[_Person])
    person = np.array([each.id for each in people], dtype=np.int64)
    known, count = np.unique(person, return_counts=True)
    if (count > 1).any():
        raise DataError(f"{path}: person {known[np.argmax(count > 1)]} is there twice, expected once per frame")
    cell = np.array([each.position for each in people], dtype=np.int64)
    return person, metres(np.column_stack([cell % GRID[0], cell // GRID[0]]))


def read_detections(path: Path) -> GroundDetections:
    """Detections, rows ``frame gx gy`` on the grid of the annotations; DataError names the line that is wrong."""
    table = read_table(path, "frame gx gy")
    frame, cell = table.whole("frame"), table.value[:, 1:]
    off = np.asarray(~((cell >= 0) & (cell < GRID)).all(axis=1))  # NaN is off the grid, too
    table.refuse(off, lambda row: f"cell {cell[row, 0]:g} {cell[row, 1]:g} is off the grid of {GRID[0]} x {GRID[1]}")
    _, first, place = np.unique(table.value, axis=0, return_index=True, return_inverse=True)
    original = first[place.reshape(-1)]
    table.refuse(
        original < np.arange(len(original)),
        lambda row: f"a second detection at the place of line {table.line[original[row]]}",
    )
    return GroundDetections(table, frame, metres(cell))


def metres(cell: Floats | Ints) -> Floats:
    """Places ``[..., 2]`` in metres of grid cells ``[..., 2]``."""
    return np.asarray(np.array(CORNER) + CELL * cell)
