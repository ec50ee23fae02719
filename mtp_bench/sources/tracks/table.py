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
from ..files.columns import FORMS, TRACKS
from ..files.content import Rows, check_rows, class_id_of
from ..files.tables import find_table, read_tracks
from ..text import repeated
from .building import FEWER, stored_tracks

COLUMNS = tuple(column.name for column in TRACKS)
SCORED = COLUMNS[: COLUMNS.index("score") + 1]


def table_path(folder: Path, scene: str) -> Path:
    """Where the table of a scene is written."""
    return folder / f"{file_stem(scene)}.csv"


def read_table_of_tracks(path: Path, scene: Scene, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene; DataError names the line that is wrong."""
    rows = read_tracks(path)
    check_rows(rows, scene.frames)
    used = np.isin(rows.kind, classes)
    _refuse_misspelt(rows, classes)
    _refuse_second_box(rows)
    kept = rows.of(np.flatnonzero(used))
    class_id, velocity = class_id_of(kept, classes), kept.velocity
    return stored_tracks(
        scene.frames, kept.frame, kept.further["id"], class_id, kept.box, kept.further["score"], velocity
    )


def write_table_of_tracks(path: Path, rows: Iterable[Sequence[object]], columns: Sequence[str] = COLUMNS) -> None:
    """Write rows of the ``columns`` as a table; None is an empty cell."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(rows)


def _refuse_second_box(rows: Rows) -> None:
    """Raise DataError where a track has two boxes in a frame; the same id in another class is another track."""
    twice = repeated(rows.frame, rows.kind, rows.further["id"])
    rows.refuse(twice, "id", lambda at: f"a second box of this {rows.kind[at]} in frame {rows.frame[at]}")


def _refuse_misspelt(rows: Rows, classes: Sequence[str]) -> None:
    """Raise DataError for a class that is one of the task's in other letters ("Cars", "vehicle.car")."""
    for got in np.unique(rows.kind[~np.isin(rows.kind, classes)]).tolist():
        word = got.lower().rsplit(".", maxsplit=1)[-1]
        meant = next((name for name in classes if name.lower() in (word, word.removesuffix("s"))), None)
        if meant is not None:
            at = int(np.argmax(rows.kind == got))
            raise DataError(f"{rows.where(at, 'class')}: {got!r} is no class of the task; did you mean {meant!r}?")


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
