"""Lanes and camera images of own scenes, which pictures show and scores do not need."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...types import Ints, Lane
from ..base import CameraImage, lane_around
from ..text import RowTable
from .checks import check_ranges, frame_index
from .columns import BORDERS, PROJECTION

MOST_PIXELS = 20_000


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
    following: list[int] = []
    for row in rows.tolist() if table.has("following") else ():
        for name in filter(None, map(str.strip, str(table.words["following"][row]).split(";"))):
            if name not in number:
                raise DataError(f"{table.where(row, 'following')}: {name!r} is not a lane of this table")
            following.append(number[name])
    junction = table.has("junction") and bool(table["junction"][rows].any())
    lane = lane_around(table.matrix("x y")[rows], junction, tuple(following))
    if not table.has(BORDERS[0]):
        return lane
    return replace(lane, left=table.matrix("left_x left_y")[rows], right=table.matrix("right_x right_y")[rows])


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
    frame, width, height = frame_index(table, number), table.whole("width"), table.whole("height")
    wrong = (np.minimum(width, height) < 1) | (np.maximum(width, height) > MOST_PIXELS)
    table.refuse(wrong, f"expected a width and a height of 1 to {MOST_PIXELS} pixels", "width")
    paths = [folder / name for name in table.words["file"].tolist()]
    lost = np.array([not path.is_file() for path in paths], dtype=bool)
    table.refuse(lost, lambda row: f"no file {paths[row]}", "file")
    projection = table.matrix(" ".join(PROJECTION)).reshape(-1, 3, 4)
    return tuple(
        CameraImage(
            int(frame[i]), str(table.words["camera"][i]), paths[i], (int(width[i]), int(height[i])), projection[i]
        )
        for i in np.argsort(frame, kind="stable").tolist()
    )
