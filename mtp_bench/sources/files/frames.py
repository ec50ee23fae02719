"""Frames of a scene, from its tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import DataError
from ...types import Floats, Ints
from .table import ColumnTable

MOST_FRAMES = 1_000_000
CLOSE = 1e-3  # s: largest difference of times of one frame
GAP = 1.5  # periods: a larger step between two frames means that one is missing
_NO_ROWS = "its tables have no rows; an ego table defines the frames"


@dataclass(frozen=True, eq=False)
class SceneFrames:
    """Frames of a scene."""

    number: Ints | None  # [F] rising; None: rows have times only
    time: Floats  # [F] s, rising

    def index_of(self, table: ColumnTable) -> Ints:
        """Index of each row's frame; DataError for a row of an unknown frame."""
        if self.number is None or not table.has("frame"):
            return _nearest_frame(self.time, table)
        number = table.whole("frame")
        index = np.minimum(np.searchsorted(self.number, number), len(self.number) - 1)
        first, last = self.number[0], self.number[-1]
        table.refuse(self.number[index] != number, "frame", f"no frame of the scene, which has {first} to {last}")
        if table.has("time"):
            different = np.abs(table.numbers["time"] - self.time[index]) > CLOSE
            table.refuse(different, "time", "another time than that of its frame in the other rows")
        return index


def scene_frames(where: str, tables: dict[str, ColumnTable], rate: float) -> SceneFrames:
    """Frames of a scene: the rows of its ego table, else all frames from the first to the last row of any table.

    ``rate``: frames per second if no table has times. Raises DataError.
    """
    if "ego" in tables:
        return _ego_frames(tables["ego"], rate)
    if all(table.has("frame") for table in tables.values()):
        return _numbered_frames(where, list(tables.values()), rate)
    if all(table.has("time") for table in tables.values()):
        return _timed_frames(where, list(tables.values()), rate)
    found = ", ".join(f"{name} has {'frame' if table.has('frame') else 'time'}" for name, table in tables.items())
    raise DataError(f"{where}: {found}: give both the same column, or an ego table with both")


def _ego_frames(ego: ColumnTable, rate: float) -> SceneFrames:
    if not len(ego):
        raise DataError(f"{ego.source} has no rows, expected one per frame")
    number = ego.whole("frame") if ego.has("frame") else None
    if number is not None:
        falls = np.diff(number, prepend=number[0] - 1) <= 0
        ego.refuse(falls, "frame", "expected a number above that of the row before")
    if not ego.has("time"):
        assert number is not None  # a table has at least one of the two
        return SceneFrames(number, (number - number[0]) / rate)
    time = ego.numbers["time"]
    ego.refuse(np.diff(time, prepend=-np.inf) <= CLOSE, "time", "expected a time after that of the row before")
    return SceneFrames(number, time)


def _numbered_frames(where: str, tables: list[ColumnTable], rate: float) -> SceneFrames:
    numbers = np.unique(np.concatenate([table.whole("frame") for table in tables]))
    if not len(numbers):
        raise DataError(f"{where}: {_NO_ROWS}")
    step = int(np.gcd.reduce(np.diff(numbers))) if len(numbers) > 1 else 1
    if step > 1:
        raise DataError(
            f"{where}: rows have the frames {numbers[0]}, {numbers[1]}, ..., all {step} apart; number them 0, 1, 2, "
            "..., or define the frames by an ego table"
        )
    if numbers[-1] - numbers[0] >= MOST_FRAMES:
        raise DataError(f"{where}: frames {numbers[0]} to {numbers[-1]}, expected at most {MOST_FRAMES} frames")
    number = np.arange(numbers[0], numbers[-1] + 1)
    timed = [table for table in tables if table.has("time") and len(table)]
    if not timed:
        return SceneFrames(number, (number - number[0]) / rate)
    for table in timed:
        order = np.argsort(table.whole("frame"), kind="stable")
        rises = np.diff(table.whole("frame")[order]) > 0
        falls = np.zeros(len(table), dtype=bool)
        falls[order[1:]] = rises & (np.diff(table.numbers["time"][order]) <= 0)
        table.refuse(falls, "time", "not after the time of the frame before")
    frame = np.concatenate([table.whole("frame") for table in timed])
    known, first = np.unique(frame, return_index=True)
    time = np.concatenate([table.numbers["time"] for table in timed])[first]
    outside = np.minimum(number - known[0], 0) + np.maximum(number - known[-1], 0)  # frames without a known time
    return SceneFrames(number, np.interp(number, known, time) + outside / rate)


def _timed_frames(where: str, tables: list[ColumnTable], rate: float) -> SceneFrames:
    times = np.unique(np.concatenate([table.numbers["time"] for table in tables]))
    if not len(times):
        raise DataError(f"{where}: {_NO_ROWS}")
    time = times[np.diff(times, prepend=-np.inf) > CLOSE]
    missing = np.diff(time) > GAP / rate
    if missing.any():
        i = int(np.argmax(missing))
        raise DataError(
            f"{where}: no row between {time[i]:g} s and {time[i + 1]:g} s, at {rate:g} frames per second; frames "
            "without rows need an ego table, which has one row per frame"
        )
    return SceneFrames(None, time)


def _nearest_frame(time: Floats, table: ColumnTable) -> Ints:
    if not table.has("time"):
        raise DataError(f"{table.source}: frames by number, but the ego table has times only; add a column 'frame'")
    value = table.numbers["time"]
    last = len(time) - 1
    after = np.clip(np.searchsorted(time, value), min(1, last), last)
    index = np.where((after > 0) & (value - time[after - 1] <= time[after] - value), after - 1, after)
    table.refuse(np.abs(time[index] - value) > CLOSE, "time", "no frame of the ego table has this time")
    return index
