"""Tracks of any source: a folder with a table ``<scene>.csv`` for each scene.

Columns, in any order, named in the first line: ``frame`` (from 0), ``id`` (a number or a text), ``class`` (a name of
the task's; rows of other classes are left out), ``x y z yaw l w h`` (metres and radians, centre of the box, in the
scene's frame of reference) and, if known, ``score``, else 1, and ``vx vy`` (m/s; empty: unknown). Any other column is a
mistake; blanks around a comma are none. A slash in the name of a scene is ``%2F`` in that of its file.
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

_WITHOUT = {"score": "1"}  # what stands for a column that is left out
NUMBERS = ("frame", "x", "y", "z", "yaw", "l", "w", "h")
NEEDED = ("frame", "id", "class", "x", "y", "z", "yaw", "l", "w", "h")
SCORED = (*NEEDED, "score")
COLUMNS = (*SCORED, "vx", "vy")


def table_path(folder: Path, scene: str) -> Path:
    """Where the table of a scene is."""
    return folder / f"{file_stem(scene)}.csv"


def read_table_of_tracks(path: Path, scene: Scene, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene; DataError names the line that is wrong."""
    rows = _read(path)
    used = [(line, row) for line, row in rows if row["class"] in classes]
    if rows and not used:
        _refuse_misspelt(path, *rows[0], classes)
    value = np.array([_numbers(path, line, row) for line, row in used]).reshape(-1, 11)
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
    return stored_tracks(scene.frames, frame, identity, class_id, value[:, 1:8], value[:, 8], value[:, 9:])


def write_table_of_tracks(path: Path, rows: Iterable[Sequence[object]], columns: Sequence[str] = COLUMNS) -> None:
    """Write rows of the ``columns`` as a table; None is an empty cell."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(rows)


def _read(path: Path) -> list[tuple[int, dict[str, str]]]:
    """The rows of a table, each with its line; DataError where it is none."""
    reader = csv.DictReader(io.StringIO(read_text(path), newline=""))
    rows = []

    def at() -> str:
        return f"{path}, line {reader.line_num}"

    try:
        reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
        _require_columns(path, reader.fieldnames)
        for cells in reader:
            if None in cells or None in cells.values():
                raise DataError(f"{at()}: more or fewer columns than in the first line: is the file cut off?")
            row = {name: cell.strip() for name, cell in cells.items()}
            if not 0 < len(row["id"]) <= MOST_LETTERS:
                raise DataError(f"{at()}: id is {reprlib.repr(row['id'])}, expected 1 to {MOST_LETTERS} characters")
            rows.append((reader.line_num, row))
    except csv.Error as error:
        raise DataError(f"{at()}: {error}") from None
    return rows


def _require_columns(path: Path, names: Sequence[str]) -> None:
    lacking = [name for name in NEEDED if name not in names]
    if lacking:
        raise DataError(f"{path}: no column {', '.join(map(repr, lacking))}; expected {', '.join(COLUMNS)}")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"{path}: column {twice!r} is there twice, expected once")
    strange = next((name for name in names if name not in COLUMNS), None)
    if strange is not None:
        raise DataError(f"{path}: column {strange!r} is none of a table of tracks, expected {', '.join(COLUMNS)}")


def _refuse_misspelt(path: Path, line: int, row: dict[str, str], classes: Sequence[str]) -> None:
    """Raise DataError for a class that is one of the task's in other letters ("Cars", "vehicle.car").

    Tracks of other classes alone are fine.
    """
    word = row["class"].lower().rsplit(".", maxsplit=1)[-1]
    meant = next((name for name in classes if name.lower() in (word, word.removesuffix("s"))), None)
    if meant is not None:
        raise DataError(
            f"{path}, line {line}: class is {row['class']!r}, and no row has a class of the task; did you mean "
            f"{meant!r}?"
        )


def _numbers(path: Path, line: int, row: dict[str, str]) -> list[float]:
    """Frame, box, score and velocity of a row; NaN where a velocity is not known."""
    found = []
    for name in (*NUMBERS, "score", "vx", "vy"):
        text = row.get(name, _WITHOUT.get(name, ""))
        if not text and name in ("vx", "vy"):
            found.append(np.nan)
            continue
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
