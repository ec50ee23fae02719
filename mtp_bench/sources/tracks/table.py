"""Tracks of any source: a folder with a table ``<scene>.csv`` or ``<scene>.parquet`` for each scene.

Its columns are `sources.files.columns.TRACKS`. A slash in the name of a scene is ``%2F`` in that of its file.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...files import file_stem
from ...types import Scene, StoredTracks
from ..base import DataRoot, ReadTracks, TrackForm
from ..files.checks import check_boxes
from ..files.columns import FORMS, TRACKS
from ..files.scene import boxes_of, class_ids_of, find_table, ids_of, scores_of, velocities_of
from ..files.table import ColumnTable, read_table
from ..text import repeated
from .building import FEWER, stored_tracks

COLUMNS = tuple(column.name for column in TRACKS)
SCORED = COLUMNS[: COLUMNS.index("score") + 1]


def table_path(folder: Path, scene: str) -> Path:
    """Where the table of a scene is written."""
    return folder / f"{file_stem(scene)}.csv"


def read_table_of_tracks(path: Path, scene: Scene, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene; DataError names the line that is wrong."""
    table = read_table(path, "tracks")
    frame, number, class_id = table.whole("frame"), ids_of(table), class_ids_of(table, classes)
    check_boxes(table, frame, scene.frames)
    _refuse_misspelt(table, classes)
    kind = table.words["class"]
    twice = repeated(frame, kind, number)  # an id in another class is another track
    table.refuse(twice, "id", lambda row: f"a second box of this {kind[row]} in frame {frame[row]}")
    row, velocity = np.flatnonzero(class_id >= 0), velocities_of(table)
    return stored_tracks(
        scene.frames,
        frame[row],
        number[row],
        class_id[row],
        boxes_of(table)[row],
        scores_of(table)[row],
        None if velocity is None else velocity[row],
    )


def write_table_of_tracks(path: Path, rows: Iterable[Sequence[object]], columns: Sequence[str] = COLUMNS) -> None:
    """Write rows of the ``columns`` as a table; None is an empty cell."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(rows)


def _refuse_misspelt(table: ColumnTable, classes: Sequence[str]) -> None:
    """Raise DataError for a class that is one of the task's in other letters ("Cars", "vehicle.car")."""
    kind = table.words["class"]
    for got in np.unique(kind[~np.isin(kind, classes)]).tolist():
        word = got.lower().rsplit(".", maxsplit=1)[-1]
        meant = next((name for name in classes if name.lower() in (word, word.removesuffix("s"))), None)
        if meant is not None:
            where = table.where(int(np.argmax(kind == got)), "class")
            raise DataError(f"{where}: {got!r} is not a class of the task; did you mean {meant!r}?")


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    def read(scene: Scene) -> StoredTracks:
        path = find_table(folder, file_stem(scene.name))
        if path is None:
            raise DataError(
                f"no file {table_path(folder, scene.name)}, expected the tracks of each scene that is run; {FEWER}"
            )
        return read_table_of_tracks(path, scene, card.task.classes)

    return read


def _fits(path: Path) -> bool:
    return path.is_dir() and any(any(path.glob(f"*.{form}")) for form in FORMS)


TABLE = TrackForm("a folder with a table <scene>.csv or <scene>.parquet for each scene", _fits, _open)
