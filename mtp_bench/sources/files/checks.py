"""Checks of own scenes: frames, the ego, boxes and objects."""

from collections.abc import Sequence

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Ints
from ..text import (
    LIMIT,
    RADIANS,
    SMALLEST,
    TURN,
    RowTable,
    refuse,
    refuse_shared_place,
    repeated,
)
from .columns import BORDERS

MOST_FRAMES = 1_000_000
FARTHEST = 1e5  # m, x and y: rollouts keep boxes in single precision, which is coarser than centimetres farther away
TOLERANCE = 0.2  # share by which the frame period of a scene may differ from the task's
_NEAR = (
    f"expected -{FARTHEST:g} to {FARTHEST:g} m: boxes are kept in single precision, so subtract a fixed origin from "
    "all coordinates, such as the first position of the ego"
)
_SIZE = SMALLEST, LIMIT, f"expected a number from {SMALLEST:g} to {LIMIT:g}"
_VELOCITY = -LIMIT, LIMIT, f"expected a number from {-LIMIT:g} to {LIMIT:g}"
RANGES = {  # column -> least, largest, message
    **dict.fromkeys(("x", "y", *BORDERS), (-FARTHEST, FARTHEST, _NEAR)),
    **dict.fromkeys(("l", "w", "h"), _SIZE),
    **dict.fromkeys(("z", "vx", "vy", "score"), _VELOCITY),
    "yaw": (-TURN, TURN, RADIANS),
    "visible": (0.0, 1.0, "expected a number from 0 to 1"),
}


def scene_frames(
    where: str, tables: dict[str, RowTable], rate: float
) -> tuple[Ints, Floats]:
    """Numbers [F], rising, and times [F] in s of the frames: the rows of the ego table, else all numbers in use.

    ``rate``: frames per second if there is no ego table with times. Raises DataError.
    """
    ego = tables.get("ego")
    if ego is not None:
        if not len(ego):
            raise DataError(f"{ego.source} has no rows, expected one per frame")
        number = ego.whole("frame")
        falls = np.diff(number, prepend=number[0] - 1) <= 0
        ego.refuse(falls, "expected a number above that of the row before", "frame")
        return number, ego.numbers["time"] if ego.has("time") else (
            number - number[0]
        ) / rate
    used = np.unique(
        np.concatenate([table.whole("frame") for table in tables.values()])
    )
    if not len(used):
        raise DataError(
            f"{where}: its tables have no rows; an ego table defines the frames"
        )
    step = int(np.gcd.reduce(np.diff(used))) if len(used) > 1 else 1
    if step > 1:
        advice = "number them 0, 1, 2, ..., or define the frames by an ego table"
        raise DataError(
            f"{where}: rows have the frames {used[0]}, {used[1]}, ..., all {step} apart; {advice}"
        )
    if used[-1] - used[0] >= MOST_FRAMES:
        raise DataError(
            f"{where}: frames {used[0]} to {used[-1]}, expected at most {MOST_FRAMES} frames"
        )
    number = np.arange(used[0], used[-1] + 1)
    return number, (number - number[0]) / rate


def frame_index(table: RowTable, number: Ints) -> Ints:
    """Index of each row's frame among the ``number`` [F] of a scene; DataError for an unknown frame."""
    frame = table.whole("frame")
    index = np.minimum(np.searchsorted(number, frame), len(number) - 1)
    table.refuse(
        number[index] != frame,
        f"no frame of the scene, which has {number[0]} to {number[-1]}",
        "frame",
    )
    return index


def check_frames(time: Floats, ego: Floats, card: Card, where: str) -> None:
    """Raise DataError unless there are frames with rising times, the task's period and possible poses of the ego.

    Frames may be missing: no track or forecast crosses such a hole in time.
    """
    if not len(time):
        raise DataError(f"{where}: no frames, expected at least one")
    wrong = ~((np.abs(time) < np.inf) & (np.diff(time, prepend=-np.inf) > 0))
    expected = "expected a number above that of the frame before"
    refuse(wrong, lambda t: f"{where}: time {time[t]:g} of frame {t}, {expected}")
    place, yaw = ego[:, :3], ego[:, 3]
    far = ~(np.abs(place) <= FARTHEST).ravel()
    refuse(
        far,
        lambda i: (
            f"{where}: {'xyz'[i % 3]} of the ego in frame {i // 3} is {place.flat[i]:.10g}, {_NEAR}"
        ),
    )
    refuse(
        ~(np.abs(yaw) <= TURN),
        lambda t: f"{where}: yaw of the ego in frame {t} is {yaw[t]:g}, {RADIANS}",
    )
    period, step = 1.0 / card.task.rate, np.diff(time)
    median = float(np.median(step)) if len(step) else period
    if abs(median - period) > TOLERANCE * period:
        raise DataError(
            f"{where}: frames are {median:g} s apart, but {card.id} has {card.task.rate:g} frames per second: keep "
            "frames of that rate alone, or take a card with the rate of the scene"
        )


def check_boxes(table: RowTable, frame: Ints, frames: int, true: bool) -> None:
    """Raise DataError for the first impossible value; only ``true`` boxes need a size above 0."""
    outside = (frame < 0) | (frame >= frames)
    table.refuse(
        outside,
        lambda row: (
            f"frame {frame[row]}, but the scene has the frames 0 to {frames - 1}"
        ),
        "frame",
    )
    check_ranges(table, true)


def check_ranges(table: RowTable, true: bool = True) -> None:
    """Raise DataError for the first number outside of its range; only ``true`` boxes need a size above 0."""
    for column in filter(table.has, RANGES):
        _check_range(
            table, column, -LIMIT if column in "lwh" and not true else RANGES[column][0]
        )


def _check_range(table: RowTable, column: str, low: float) -> None:
    _, high, expected = RANGES[column]
    value = table.numbers[column]
    unknown = np.isnan(value) & (column in ("vx", "vy"))
    bad = ~(unknown | ((value >= low) & (value <= high)))
    table.refuse(bad, lambda row: f"{value[row]:.10g}, {expected}", column)


def check_objects(
    table: RowTable, frame: Ints, number: Ints, classes: Sequence[str]
) -> None:
    """Raise DataError if an object has two boxes in a frame or two classes of the task, or two objects one place."""
    table.refuse(
        repeated(frame, number), "a second box of this object in this frame", "id"
    )
    kind = table.words["class"]
    used = np.flatnonzero(np.isin(kind, classes))
    name = table.words.get("id", number)
    refuse_shared_place(
        frame[used],
        table.matrix("x y")[used],
        name[used],
        lambda row: table.where(used[row]),
    )
    order = used[np.lexsort((frame[used], number[used]))]
    changed = np.zeros(len(kind), dtype=bool)
    changed[order[1:]] = (np.diff(number[order]) == 0) & (
        kind[order[1:]] != kind[order[:-1]]
    )
    table.refuse(
        changed,
        lambda row: f"{str(kind[row])!r}, but this object has another class before",
        "class",
    )
