"""Tracks of any source: a folder with a table ``<scene>.csv`` for each scene.

Columns, in any order, named in the first line: ``frame`` (from 0), ``id`` (a number or a text), ``class`` (a name of
the task's; rows of other classes are left out), ``x y z yaw l w h`` (metres and radians, centre of the box, in the
scene's frame of reference) and, if known, ``score``. A slash in the name of a scene is ``%2F`` in that of its file.
"""

from __future__ import annotations

import csv
import io
import reprlib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...files import file_stem
from ...types import Scene, StoredTracks
from ..base import DataRoot, ReadTracks, TrackForm
from ..text import LIMIT, MOST_LETTERS, RADIANS, TURN, read_text
from .building import FEWER, stored_tracks

NUMBERS = ("frame", "x", "y", "z", "yaw", "l", "w", "h")
COLUMNS = ("frame", "id", "class", "x", "y", "z", "yaw", "l", "w", "h", "score")


def table_path(folder: Path, scene: str) -> Path:
    """Where the table of a scene is."""
    return folder / f"{file_stem(scene)}.csv"


def read_table_of_tracks(path: Path, scene: Scene, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene; DataError names the line that is wrong."""
    rows = _read(path)
    used = [(line, row) for line, row in rows if row["class"] in classes]
    if rows and not used:
        _refuse_misspelt(path, *rows[0], classes)
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


def _read(path: Path) -> list[tuple[int, dict[str, str]]]:
    """The rows of a table, each with its line; DataError where it is none."""
    reader = csv.DictReader(io.StringIO(read_text(path), newline=""))
    rows = []

    def at() -> str:
        return f"{path}, line {reader.line_num}"

    try:
        _require_columns(path, reader.fieldnames or ())
        for row in reader:
            if None in row or None in row.values():
                raise DataError(f"{at()}: more or fewer columns than in the first line: is the file cut off?")
            if not 0 < len(row["id"]) <= MOST_LETTERS:
                raise DataError(f"{at()}: id is {reprlib.repr(row['id'])}, expected 1 to {MOST_LETTERS} characters")
            rows.append((reader.line_num, row))
    except csv.Error as error:
        raise DataError(f"{at()}: {error}") from None
    return rows


def _require_columns(path: Path, names: Sequence[str]) -> None:
    lacking = [name for name in COLUMNS[:-1] if name not in names]
    if lacking:
        raise DataError(f"{path}: no column {', '.join(map(repr, lacking))}; expected {', '.join(COLUMNS)}")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"{path}: column {twice!r} is there twice, expected once")


def _refuse_misspelt(path: Path, line: int, row: dict[str, str], classes: Sequence[str]) -> None:
    """Raise DataError for a class that is one of the task's but for its case; tracks of others alone are fine."""
    meant = next((name for name in classes if name.lower() == row["class"].lower()), None)
    if meant is not None:
        raise DataError(
            f"{path}, line {line}: class is {row['class']!r}, and no row has a class of the task; did you mean "
            f"{meant!r}?"
        )


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
        if name == "yaw" and abs(value) > TURN:
            raise DataError(f"{path}, line {line}: yaw is {text!r}, {RADIANS}")
        found.append(value)
    return found


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    def read(scene: Scene) -> StoredTracks:
        path = table_path(folder, scene.name)
        if not path.is_file():
            raise DataError(f"no file {path}, expected the tracks of each scene that is run; {FEWER}")
        return read_table_of_tracks(path, scene, card.task.classes)

    return read


def _fits(path: Path) -> bool:
    return path.is_dir() and any(path.glob("*.csv"))


TABLE = TrackForm("a folder with a table <scene>.csv for each scene", _fits, _open)
