"""A scene in tables: the files ``truth``, ``detections`` and ``ego`` of a folder, and the frames that they are of."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...types import ID_LIMIT, Floats, Ints
from .cells import Cells, read_cells
from .columns import BOX, FORMS, TABLES
from .content import Content, Rows

MOST_FRAMES = 1_000_000
CLOSE = 1e-3  # s: times that are no farther apart are of one frame
_NEARLY = 0.9  # alike: `detection`, not `detections_old`
GAP = 1.5  # periods: more between two frames, and one is lacking


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a scene."""

    number: Ints | None  # [F] rising; None: rows say their frame by its time
    time: Floats  # [F] s, rising

    def of(self, cells: Cells) -> Ints:
        """The frame of each row, by its place among the frames; DataError for a row of none of them."""
        if self.number is None or not cells.has("frame"):
            return _nearest(self.time, cells)
        number = cells.whole("frame")
        frame = np.minimum(np.searchsorted(self.number, number), len(self.number) - 1)
        first, last = self.number[0], self.number[-1]
        cells.refuse(self.number[frame] != number, "frame", f"no frame of the scene, which has {first} to {last}")
        if cells.has("time"):
            off = np.abs(cells.number["time"] - self.time[frame]) > CLOSE
            cells.refuse(off, "time", "another time than that of its frame in the other rows")
        return frame


def read_tables(folder: Path, rate: float) -> Content:
    """The scene whose tables are in ``folder``, which has its name; ``rate``: frames per second where no time is said.

    Raises DataError that names the file, the line and the column that is wrong.
    """
    found = {table: find_table(folder, table) for table in TABLES}
    _refuse_misspelt(folder, [table for table, path in found.items() if path is None])
    if found["truth"] is None:
        raise DataError(f"{folder}: no table truth.csv or truth.parquet, without which nothing can be scored")
    cells = {table: read_cells(path, table) for table, path in found.items() if path is not None}
    frames = _frames(folder, cells, rate)
    return Content(
        name=unquote(folder.name),
        where=str(folder),
        time=frames.time,
        ego=_ego(cells.get("ego"), len(frames.time)),
        truth=_truth_rows(cells["truth"], frames),
        detections=_detection_rows(cells["detections"], frames) if "detections" in cells else None,
    )


def find_table(folder: Path, table: str) -> Path | None:
    """The file of a table; None without one. Raises DataError where there are two."""
    paths = [path for form in FORMS if (path := folder / f"{table}.{form}").is_file()]
    if len(paths) > 1:
        raise DataError(f"{folder} has {paths[0].name} and {paths[1].name}, expected one of them")
    return paths[0] if paths else None


def _refuse_misspelt(folder: Path, missing: list[str]) -> None:
    """Raise DataError for a file whose name is nearly that of a table that is not there (``detection.csv``)."""
    for path in sorted(folder.iterdir()):
        form = path.suffix.lower().removeprefix(".")
        meant = difflib.get_close_matches(path.stem.lower(), missing, n=1, cutoff=_NEARLY)
        if form in FORMS and meant:
            raise DataError(f"{path} is no table that is read; did you mean {meant[0]}.{form}?")


def _frames(folder: Path, cells: dict[str, Cells], rate: float) -> Frames:
    """The frames: those of the ego, one per row, else from the first to the last of which there is a row."""
    if "ego" in cells:
        return _listed(cells["ego"], rate)
    if all(table.has("frame") for table in cells.values()):
        return _numbered(folder, list(cells.values()), rate)
    if all(table.has("time") for table in cells.values()):
        return _timed(folder, list(cells.values()), rate)
    says = ", ".join(f"{table} has {'frame' if rows.has('frame') else 'time'}" for table, rows in cells.items())
    raise DataError(f"{folder}: {says}: give both the same column, or an ego table with both")


def _listed(ego: Cells, rate: float) -> Frames:
    if not len(ego):
        raise DataError(f"{ego.path} has no rows, expected one per frame")
    number = ego.whole("frame") if ego.has("frame") else None
    if number is not None:
        ego.refuse(
            np.diff(number, prepend=number[0] - 1) <= 0, "frame", "expected a number above that of the row before"
        )
    if not ego.has("time"):
        assert number is not None  # one of the two is always there
        return Frames(number, (number - number[0]) / rate)
    time = ego.number["time"]
    ego.refuse(np.diff(time, prepend=-np.inf) <= CLOSE, "time", "expected a time after that of the row before")
    return Frames(number, time)


def _numbered(folder: Path, tables: list[Cells], rate: float) -> Frames:
    numbers = np.unique(np.concatenate([table.whole("frame") for table in tables]))
    if not len(numbers):
        raise DataError(f"{folder}: its tables have no rows; an ego table says which frames there are")
    step = int(np.gcd.reduce(np.diff(numbers))) if len(numbers) > 1 else 1
    if step > 1:
        raise DataError(
            f"{folder}: rows are of the frames {numbers[0]}, {numbers[1]}, ..., all {step} apart; number them 0, 1, 2, "
            "..., or say by an ego table which frames there are"
        )
    if numbers[-1] - numbers[0] >= MOST_FRAMES:
        raise DataError(f"{folder}: frames {numbers[0]} to {numbers[-1]}, expected at most {MOST_FRAMES} frames")
    number = np.arange(numbers[0], numbers[-1] + 1)
    timed = [table for table in tables if table.has("time")]
    if not timed:
        return Frames(number, (number - number[0]) / rate)
    frame = np.concatenate([table.whole("frame") for table in timed])
    known, first = np.unique(frame, return_index=True)
    time = np.concatenate([table.number["time"] for table in timed])[first]
    for table in timed:
        _refuse_falling(table)
    return Frames(number, _times(number, known, time, rate))


def _times(number: Ints, known: Ints, time: Floats, rate: float) -> Floats:
    """The time of each frame from those of the ``known`` ones; before and after these, at ``rate``."""
    if not len(known):
        return np.asarray((number - number[0]) / rate)
    outside = np.minimum(number - known[0], 0) + np.maximum(number - known[-1], 0)
    return np.asarray(np.interp(number, known, time) + outside / rate)


def _refuse_falling(cells: Cells) -> None:
    """Times rise from frame to frame."""
    order = np.argsort(cells.whole("frame"), kind="stable")
    frame, time = cells.whole("frame")[order], cells.number["time"][order]
    falls = np.zeros(len(cells), dtype=bool)
    falls[order[1:]] = (np.diff(frame) > 0) & (np.diff(time) <= 0)
    cells.refuse(falls, "time", "not after the time of the frame before")


def _timed(folder: Path, tables: list[Cells], rate: float) -> Frames:
    times = np.unique(np.concatenate([table.number["time"] for table in tables]))
    if not len(times):
        raise DataError(f"{folder}: its tables have no rows; an ego table says which frames there are")
    time = times[np.diff(times, prepend=-np.inf) > CLOSE]
    gap = np.diff(time)
    if (gap > GAP / rate).any():
        at = int(np.argmax(gap > GAP / rate))
        raise DataError(
            f"{folder}: no row between {time[at]:g} s and {time[at + 1]:g} s, at {rate:g} frames per second; frames "
            "without rows need an ego table, which has one row per frame"
        )
    return Frames(None, time)


def _nearest(time: Floats, cells: Cells) -> Ints:
    if not cells.has("time"):
        raise DataError(f"{cells.path}: frames by number, but the ego table has times only; give it a column 'frame'")
    value = cells.number["time"]
    last = len(time) - 1
    after = np.clip(np.searchsorted(time, value), min(1, last), last)
    frame = np.where((after > 0) & (value - time[after - 1] <= time[after] - value), after - 1, after)
    cells.refuse(np.abs(time[frame] - value) > CLOSE, "time", "no frame of the ego table has this time")
    return frame


def _ego(ego: Cells | None, frames: int) -> Floats:
    pose = np.zeros((frames, 4))
    for place, column in enumerate(("x", "y", "z", "yaw")):
        if ego is not None and ego.has(column):
            pose[:, place] = ego.number[column]
    return pose


def read_tracks(path: Path) -> Rows:
    """The rows of a table of tracks, with frames from 0. Raises DataError for what is wrong with the table."""
    cells = read_cells(path, "tracks")
    return _rows(cells, cells.whole("frame"), {"id": _ids(cells), "score": _scores(cells)})


def _truth_rows(cells: Cells, frames: Frames) -> Rows:
    further: dict[str, NDArray[Any]] = {
        "id": _ids(cells),
        "eligible": cells.flags("eligible", default=True),
        "neutral": cells.flags("neutral", default=False),
    }
    if cells.has("visible"):
        further["visible"] = cells.number["visible"]
    return _rows(cells, frames.of(cells), further)


def _detection_rows(cells: Cells, frames: Frames) -> Rows:
    return _rows(cells, frames.of(cells), {"score": _scores(cells)})


def _scores(cells: Cells) -> Floats:
    return cells.number.get("score", np.ones(len(cells)))


def _rows(cells: Cells, frame: Ints, further: dict[str, NDArray[Any]]) -> Rows:
    columns = {"z": cells.number["h"] / 2, **cells.number}
    velocity = np.column_stack([columns["vx"], columns["vy"]]) if cells.has("vx") else None
    box = np.column_stack([columns[name] for name in BOX])
    return Rows(cells.where, frame, box, velocity, cells.text["class"], further)


def _ids(cells: Cells) -> Ints:
    """Numbers of the objects: those of the file, or, of words, their places among all words, sorted.

    Where a number is below 0 or above `ID_LIMIT`, all are words.
    """
    words = cells.text["id"]
    try:
        number = words.astype(np.int64) if len(words) else np.zeros(0, dtype=np.int64)
        fits = not ((number < 0) | (number > ID_LIMIT)).any()
        if fits and np.array_equal(number.astype(np.str_), words):  # else 1 and 01 would be one object
            return number
    except (ValueError, OverflowError):
        pass
    return np.unique(words, return_inverse=True)[1].astype(np.int64)
