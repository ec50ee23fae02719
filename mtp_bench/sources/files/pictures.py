"""Lanes and camera images of own scenes, which pictures show and scores do not need."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...types import Floats, Ints, Lane
from ..base import CameraImage
from ..text import RowTable, refuse
from .checks import check_ranges, frame_index
from .columns import BORDERS

HALF = 1.75  # m, from the middle line to borders that a table does not have


def lanes_of(table: RowTable) -> tuple[Lane, ...]:
    """Lanes of a table, in the order of their first rows; DataError names the row that is wrong."""
    check_ranges(table)
    names, first, of_row, count = np.unique(
        table.words["lane"], return_index=True, return_inverse=True, return_counts=True
    )
    table.refuse((count == 1)[of_row], "the only point of this lane, expected two or more", "lane")
    rows, order = np.split(np.argsort(of_row, kind="stable"), np.cumsum(count)[:-1]), np.argsort(first).tolist()
    number = {str(names[lane]): place for place, lane in enumerate(order)}
    return tuple(_lane(table, rows[lane], number) for lane in order)


def _lane(table: RowTable, rows: Ints, number: dict[str, int]) -> Lane:
    center = table.matrix("x y")[rows]
    if table.has(BORDERS[0]):
        left, right = table.matrix("left_x left_y")[rows], table.matrix("right_x right_y")[rows]
    else:
        aside = _aside(center)
        left, right = center + aside, center - aside
    following: list[int] = []
    for row in rows.tolist() if table.has("following") else ():
        for name in filter(None, map(str.strip, str(table.words["following"][row]).split(";"))):
            if name not in number:
                raise DataError(f"{table.where(row, 'following')}: {name!r} is not a lane of this table")
            following.append(number[name])
    junction = table.has("junction") and bool(table["junction"][rows].any())
    return Lane(center, left, right, tuple(following), junction)


def _aside(center: Floats) -> Floats:
    """Vectors [n, 2] of length `HALF` to the left of a line [n, 2]."""
    step = np.gradient(center, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    return np.asarray(HALF * np.column_stack([-step[:, 1], step[:, 0]]) / length)


def lane_columns(lanes: Sequence[Lane]) -> dict[str, NDArray[Any]]:
    """Columns of the table of at least one lane."""
    count = [len(lane.center) for lane in lanes]
    following = [[";".join(map(str, lane.following)), *[""] * (n - 1)] for lane, n in zip(lanes, count, strict=True)]
    lines = [np.concatenate([getattr(lane, line) for lane in lanes]) for line in ("center", "left", "right")]
    return {
        "lane": np.repeat(np.arange(len(lanes)), count),
        **dict(zip(("x", "y", *BORDERS), np.column_stack(lines).T, strict=True)),
        "junction": np.repeat([int(lane.junction) for lane in lanes], count),
        "following": np.concatenate(following),
    }


def images_of(table: RowTable, folder: Path, number: Ints) -> tuple[CameraImage, ...]:
    """Images of a table of the scene in ``folder``, sorted by frame; DataError names the row that is wrong.

    ``number`` [F]: of the frames of the scene.
    """
    frame, size = frame_index(table, number), np.column_stack([table.whole("width"), table.whole("height")])
    table.refuse(size.min(axis=1, initial=1) < 1, "expected a width and a height of 1 pixel or more", "width")
    paths = [folder / name for name in table.words["file"].tolist()]
    lost = np.array([not path.is_file() for path in paths], dtype=bool)
    refuse(lost, lambda row: f"{table.where(row, 'file')}: no file {paths[row]}")
    projection = np.stack([table[f"p{i}{j}"] for i in range(3) for j in range(4)], axis=1).reshape(-1, 3, 4)
    return tuple(
        CameraImage(int(frame[row]), str(table.words["camera"][row]), paths[row], (w, h), projection[row])
        for row, (w, h) in ((row, size[row].tolist()) for row in np.argsort(frame, kind="stable").tolist())
    )
