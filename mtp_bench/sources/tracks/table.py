"""Tracks of any source: a folder with a table ``<scene>.csv`` for each scene.

Columns, in any order, named in the first line: ``frame`` (from 0), ``id`` (a number or a text), ``class`` (a name of
the task's; rows of other classes are left out), ``x y z yaw l w h`` (metres and radians, centre of the box, in the
scene's frame of reference) and, if known, ``score``. A slash in the name of a scene is ``%2F`` in that of its file.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Scene, StoredTracks
from ..base import DataRoot, ReadTracks, TrackForm
from ..text import LIMIT, read_text
from .building import stored_tracks

NUMBERS = ("frame", "x", "y", "z", "yaw", "l", "w", "h")
COLUMNS = ("frame", "id", "class", "x", "y", "z", "yaw", "l", "w", "h", "score")


def table_path(folder: Path, scene: str) -> Path:
    """Where the table of a scene is."""
    return folder / f"{quote(scene, safe='')}.csv"


def read_table_of_tracks(path: Path, scene: Scene, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene; DataError names the line that is wrong."""
    rows = list(csv.DictReader(read_text(path).splitlines()))
    _require_columns(path, rows)
    for line, row in enumerate(rows, 2):
        if None in row or None in row.values():
            raise DataError(f"{path}, line {line}: more or fewer columns than in the first line: is the file cut off?")
    used = [(line, row) for line, row in enumerate(rows, 2) if row["class"] in classes]
    value = np.array([_numbers(path, line, row) for line, row in used]).reshape(-1, 9)
    frame = value[:, 0].astype(np.int64)
    identity = np.array([row["id"] for _, row in used], dtype=np.str_)
    class_id = np.array([classes.index(row["class"]) for _, row in used], dtype=np.int64)
    seen: set[tuple[int, str, str]] = set()
    for (line, row), t in zip(used, frame.tolist(), strict=True):
        if not 0 <= t < scene.frames:
            raise DataError(f"{path}, line {line}: frame {t}, but scene {scene.name!r} has {scene.frames} frames")
        if (key := (t, row["class"], row["id"])) in seen:
            raise DataError(f"{path}, line {line}: a second box of {row['class']} {row['id']} in frame {t}")
        seen.add(key)
    return stored_tracks(scene.frames, frame, identity, class_id, value[:, 1:8], value[:, 8])


def write_table_of_tracks(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows of `COLUMNS` as a table."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        table.writerows(rows)


def _require_columns(path: Path, rows: Sequence[dict[str, str]]) -> None:
    lacking = [name for name in COLUMNS[:-1] if rows and name not in rows[0]]
    if lacking:
        raise DataError(f"{path}: no column {', '.join(map(repr, lacking))}; expected {', '.join(COLUMNS)}")


def _numbers(path: Path, line: int, row: dict[str, str]) -> list[float]:
    """Frame, box and score of a row."""
    found = []
    for name in (*NUMBERS, "score"):
        text = row.get(name, "1") if name == "score" else row[name]
        try:
            value = float(text)
        except (TypeError, ValueError):
            value = np.nan
        if not abs(value) <= LIMIT or (name == "frame" and value != int(value)) or (name in "lwh" and value <= 0):
            what = {"frame": "a whole number", "l": "a size above 0", "w": "a size above 0", "h": "a size above 0"}
            raise DataError(f"{path}, line {line}: {name} is {text!r}, expected {what.get(name, 'a finite number')}")
        found.append(value)
    return found


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    def read(scene: Scene) -> StoredTracks:
        return read_table_of_tracks(table_path(folder, scene.name), scene, card.task.classes)

    return read


def _fits(path: Path) -> bool:
    return path.is_dir() and any(path.glob("*.csv"))


TABLE = TrackForm("a folder with a table <scene>.csv for each scene", _fits, _open)
