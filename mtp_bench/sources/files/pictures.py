"""Lanes and camera images of own scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import DataError, Ints, Lane
from ..base import CameraImage, lane_around
from ..tables import RowTable
from .columns import BORDERS, PROJECTION, check_ranges, frame_index

MAX_PIXELS = 10_000


def lanes_of(table: RowTable) -> tuple[Lane, ...]:
    """Return the lanes of a table, in the order of their first rows.

    DataError names the row that is wrong.
    """
    check_ranges(table)
    lane_names, first_row, lane_of_row, point_count = np.unique(
        table["lane"], return_index=True, return_inverse=True, return_counts=True
    )
    is_single = (point_count == 1)[lane_of_row]
    table.refuse(is_single, "the only point of this lane, expected two or more", "lane")
    lane_order = np.argsort(first_row)
    sorted_rows = np.argsort(lane_of_row, kind="stable")
    rows_of_lane = np.split(sorted_rows, np.cumsum(point_count)[:-1])
    lane_numbers = {
        name: index for index, name in enumerate(lane_names[lane_order].tolist())
    }
    return tuple(
        _lane(table, rows_of_lane[lane], lane_numbers) for lane in lane_order.tolist()
    )


def _lane(table: RowTable, rows: Ints, lane_numbers: Mapping[str, int]) -> Lane:
    is_junction = "junction" in table and bool(table["junction"][rows].any())
    lane = lane_around(table.matrix("x y")[rows], is_junction)
    if "following" in table:
        lane = replace(lane, following=_following(table, rows, lane_numbers))
    if BORDERS[0] in table:
        left_border = table.matrix("left_x left_y")[rows]
        right_border = table.matrix("right_x right_y")[rows]
        lane = replace(lane, left=left_border, right=right_border)
    return lane


def _following(
    table: RowTable, rows: Ints, lane_numbers: Mapping[str, int]
) -> tuple[int, ...]:
    """Return the numbers of the lanes that continue a lane, each once."""
    following: list[int] = []
    for row in rows.tolist():
        for name in table["following"].item(row).split():
            if name not in lane_numbers:
                where = table.where(row, "following")
                raise DataError(f"{where}: {name!r}, expected a lane of this table")
            if lane_numbers[name] not in following:
                following.append(lane_numbers[name])
    return tuple(following)


def lane_columns(lanes: Sequence[Lane]) -> dict[str, NDArray[Any]]:
    """Return the columns of a table of one lane or more."""
    count = [len(lane.center) for lane in lanes]
    names = [" ".join(map(str, lane.following)) for lane in lanes]
    points = np.concatenate(
        [np.column_stack([lane.center, lane.left, lane.right]) for lane in lanes]
    )
    return {
        "lane": np.repeat(np.arange(len(lanes)), count),
        **dict(zip(("x", "y", *BORDERS), points.T, strict=True)),
        "junction": np.repeat([int(lane.junction) for lane in lanes], count),
        "following": np.repeat(names, count),
    }


def images_of(
    table: RowTable, folder: Path, frame_numbers: Ints
) -> tuple[CameraImage, ...]:
    """Return the images of a scene in ``folder``, sorted by frame.

    ``frame_numbers`` [F]: number in the table of each frame. DataError names the row
    that is wrong.
    """
    frame = frame_index(table, frame_numbers)
    width = table.whole_numbers("width")
    height = table.whole_numbers("height")
    is_wrong = (np.minimum(width, height) < 1) | (
        np.maximum(width, height) > MAX_PIXELS
    )
    expected = f"expected a width and a height of 1 to {MAX_PIXELS} pixels"
    table.refuse(is_wrong, expected, "width")
    file_names = [Path(name) for name in table["file"].tolist()]
    is_outside = [name.is_absolute() or ".." in name.parts for name in file_names]
    expected = "expected a path inside of the folder of the scene"
    table.refuse(np.array(is_outside, dtype=bool), expected, "file")
    paths = [folder / name for name in file_names]
    is_missing = np.array([not path.is_file() for path in paths], dtype=bool)
    table.refuse(is_missing, lambda row: f"no file {paths[row]}", "file")
    projection = table.matrix(" ".join(PROJECTION)).reshape(-1, 3, 4)
    images = [
        CameraImage(
            frame=int(frame[row]),
            camera=table["camera"].item(row),
            path=paths[row],
            size=(int(width[row]), int(height[row])),
            projection=projection[row],
        )
        for row in np.argsort(frame, kind="stable").tolist()
    ]
    return tuple(images)
