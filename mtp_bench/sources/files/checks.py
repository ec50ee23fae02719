"""Checks of own scenes: boxes, objects, frames and the ego."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Bools, Floats, Ints
from ..text import LIMIT, RADIANS, TURN, refuse, repeated
from .table import ColumnTable

SMALLEST = 1e-6  # m, size of a box
FARTHEST = 1e5  # m, x and y: rollouts keep boxes in single precision, which is coarser than centimetres farther away
TOLERANCE = 0.2  # share by which the frame period of a scene may differ from the task's
GAP = 10.5  # periods: a larger step between two frames means two scenes


def check_boxes(table: ColumnTable, frame: Ints, frames: int) -> None:
    """Raise DataError for the first impossible value."""
    outside = (frame < 0) | (frame >= frames)
    table.refuse(outside, "frame", lambda row: f"frame {frame[row]}, but the scene has the frames 0 to {frames - 1}")
    ranges = {**dict.fromkeys(("x", "y", "z"), (-LIMIT, LIMIT)), **dict.fromkeys(("l", "w", "h"), (SMALLEST, LIMIT))}
    for column, (low, high) in {**ranges, "score": (-LIMIT, LIMIT), "visible": (0.0, 1.0)}.items():
        if table.has(column):
            _refuse_outside(table, column, low, high)
    for column in ("x", "y"):
        _refuse_far(table, column)
    yaw = table.numbers["yaw"]
    table.refuse(~(np.abs(yaw) <= TURN), "yaw", lambda row: f"{yaw[row]:g}, {RADIANS}")
    for column in ("vx", "vy"):
        if table.has(column):
            value = table.numbers[column]
            table.refuse(np.abs(value) > LIMIT, column, f"expected a number from {-LIMIT:g} to {LIMIT:g}")


def _refuse_outside(table: ColumnTable, column: str, low: float, high: float) -> None:
    value = table.numbers[column]
    bad = ~((value >= low) & (value <= high))
    table.refuse(bad, column, lambda row: f"{value[row]:g}, expected a number from {low:g} to {high:g}")


def _refuse_far(table: ColumnTable, column: str) -> None:
    value = table.numbers[column]
    table.refuse(np.abs(value) > FARTHEST, column, lambda row: _too_far(value[row]))


def _too_far(value: float) -> str:
    return (
        f"{value:.10g}, expected -{FARTHEST:g} to {FARTHEST:g} m: boxes are kept in single precision, so subtract a "
        "fixed origin from all coordinates, such as the first position of the ego"
    )


def check_objects(table: ColumnTable, frame: Ints, number: Ints, classes: Sequence[str]) -> None:
    """Raise DataError if an object has two boxes in a frame, or two classes of the task."""
    table.refuse(repeated(frame, number), "id", "a second box of this object in this frame")
    kind = table.words["class"]
    used = np.flatnonzero(np.isin(kind, classes))
    order = used[np.lexsort((frame[used], number[used]))]
    changed: Bools = np.zeros(len(kind), dtype=bool)
    changed[order[1:]] = (np.diff(number[order]) == 0) & (kind[order[1:]] != kind[order[:-1]])
    table.refuse(changed, "class", lambda row: f"{str(kind[row])!r}, but this object has another class before")


def check_frames(time: Floats, ego: Floats, card: Card, where: str) -> None:
    """Raise DataError unless there are frames with rising times, the task's period and possible poses of the ego."""
    if not len(time):
        raise DataError(f"{where}: no frames, expected at least one")
    wrong = ~((np.abs(time) < np.inf) & (np.diff(time, prepend=-np.inf) > 0))
    expected = "expected a number above that of the frame before"
    refuse(wrong, lambda t: f"{where}: time {time[t]:g} of frame {t}, {expected}")
    if not (np.abs(ego) <= LIMIT).all():
        raise DataError(f"{where}: the ego has a position that is not finite")
    position, yaw = ego[:, :3], ego[:, 3]
    moved = np.abs(position - position[0])  # agents see positions relative to the first one
    refuse(
        (np.abs(position) > FARTHEST).ravel(),
        lambda i: f"{where}: {'xyz'[i % 3]} of the ego in frame {i // 3} is {_too_far(float(position.flat[i]))}",
    )
    refuse(
        (moved > FARTHEST).ravel(),
        lambda i: (
            f"{where}: {'xyz'[i % 3]} of the ego in frame {i // 3} is {moved.flat[i]:g} m from that of frame 0, "
            f"expected at most {FARTHEST:g} m; split the scene"
        ),
    )
    refuse(np.abs(yaw) > TURN, lambda t: f"{where}: yaw of the ego in frame {t} is {yaw[t]:g}, {RADIANS}")
    check_period(time, card, where)


def check_period(time: Floats, card: Card, where: str) -> None:
    """Raise DataError, which begins with ``where``, unless the frames have the period of the task of ``card``.

    Some frames may be missing. Tracks and forecasts do not bridge a longer gap: two clips are two scenes.
    """
    period = 1.0 / card.task.rate
    median = float(np.median(np.diff(time))) if len(time) > 1 else period
    if abs(median - period) > TOLERANCE * period:
        stride = round(period / median)
        advice = "take a card with that rate"
        if stride > 1 and abs(stride * median - period) <= TOLERANCE * period:
            advice = f"keep every {stride}th frame, or {advice}" if stride > 3 else f"keep one frame of {stride}"
        raise DataError(
            f"{where}: frames are {median:g} s apart, but {card.id} has {card.task.rate:g} frames per second: {advice}"
        )
    step, longest = np.diff(time), GAP * period
    expected = f"expected at most {longest:g} s; make a scene of each side"
    refuse(step > longest, lambda t: f"{where}: frame {t + 1} is {step[t]:g} s after the one before, {expected}")
