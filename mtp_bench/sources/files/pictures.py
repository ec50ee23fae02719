"""Lanes and camera images of own scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import DataError, Ints, Lane
from ..base import CameraImage, lane_around
from ..text import RowTable
from .checks import check_ranges, frame_index
from .columns import BORDERS, PROJECTION

MOST_PIXELS = 10_000


def lanes_of(table: RowTable) -> tuple[Lane, ...]:
    """Lanes of a table, in the order of their first rows; DataError names the row that is wrong."""
    check_ranges(table)
    name, first, of_row, count = np.unique(table.words["lane"], True, True, True)
    table.refuse(
        (count == 1)[of_row],
        "the only point of this lane, expected two or more",
        "lane",
    )
    rows = np.split(np.argsort(of_row, kind="stable"), np.cumsum(count)[:-1])
    order = np.argsort(first)
    number = {word: index for index, word in enumerate(name[order].tolist())}
    return tuple(_lane(table, rows[lane], number) for lane in order.tolist())


def _lane(table: RowTable, rows: Ints, number: Mapping[str, int]) -> Lane:
    lane = lane_around(
        table.matrix("x y")[rows],
        table.has("junction") and bool(table["junction"][rows].any()),
    )
    if table.has("following"):
        lane = replace(lane, following=_following(table, rows, number))
    if not table.has(BORDERS[0]):
        return lane
    return replace(
        lane,
        left=table.matrix("left_x left_y")[rows],
        right=table.matrix("right_x right_y")[rows],
    )


def _following(
    table: RowTable, rows: Ints, number: Mapping[str, int]
) -> tuple[int, ...]:
    """Numbers of the lanes that any row of a lane names, each once."""
    found: dict[int, None] = {}
    for row in rows.tolist():
        for word in table.words["following"].item(row).split():
            if word not in number:
                raise DataError(
                    f"{table.where(row, 'following')}: {word!r}, expected a lane of this table"
                )
            found[number[word]] = None
    return tuple(found)


def lane_columns(lanes: Sequence[Lane]) -> dict[str, NDArray[Any]]:
    """Columns of the table of at least one lane."""
    count = [len(lane.center) for lane in lanes]
    lines = [
        np.concatenate([getattr(lane, line) for lane in lanes])
        for line in ("center", "left", "right")
    ]
    return {
        "lane": np.repeat(np.arange(len(lanes)), count),
        **dict(zip(("x", "y", *BORDERS), np.column_stack(lines).T, strict=True)),
        "junction": np.repeat([int(lane.junction) for lane in lanes], count),
        "following": np.repeat(
            [" ".join(map(str, lane.following)) for lane in lanes], count
        ),
    }


def images_of(table: RowTable, folder: Path, number: Ints) -> tuple[CameraImage, ...]:
    """Images of a table of the scene in ``folder``, sorted by frame; DataError names the row that is wrong.

    ``number`` [F]: of the frames of the scene.
    """
    frame, width, height = (
        frame_index(table, number),
        table.whole("width"),
        table.whole("height"),
    )
    wrong = (np.minimum(width, height) < 1) | (np.maximum(width, height) > MOST_PIXELS)
    table.refuse(
        wrong, f"expected a width and a height of 1 to {MOST_PIXELS} pixels", "width"
    )
    paths = [folder / name for name in table.words["file"].tolist()]
    away = np.array(
        [
            Path(name).is_absolute() or ".." in Path(name).parts
            for name in table.words["file"].tolist()
        ]
    )
    table.refuse(away, "expected a path inside of the folder of the scene", "file")
    lost = np.array([not path.is_file() for path in paths], dtype=bool)
    table.refuse(lost, lambda row: f"no file {paths[row]}", "file")
    projection = table.matrix(" ".join(PROJECTION)).reshape(-1, 3, 4)
    camera, size = (
        table.words["camera"].tolist(),
        np.column_stack([width, height]).tolist(),
    )
    order = np.argsort(frame, kind="stable").tolist()
    return tuple(
        CameraImage(int(frame[i]), camera[i], paths[i], tuple(size[i]), projection[i])
        for i in order
    )
