"""Columns of the tables of own scenes, also for their documentation, and checks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Ints
from ..readers import TableColumn
from ..tables import (
    MAX_ANGLE_RAD,
    RADIANS,
    SMALLEST_SIDE_M,
    RowTable,
    refuse,
    refuse_shared_place,
)
from ..text import LIMIT

FORMS = ("csv", "parquet")  # suffixes of tables
BOX_COLUMNS = ("x", "y", "z", "yaw", "l", "w", "h")
# s: clocks that count from 1970 fit
_LATEST_TIME_S = 1e12

_FRAME = TableColumn("frame", "number of the frame, a whole number")
_CENTRE = (
    TableColumn("x", "m, centre of the box"),
    TableColumn("y", "m, centre of the box"),
    TableColumn(
        "z",
        "m, centre of the box",
        "half of `h`, as if all objects stood on the ground at z = 0",
    ),
    TableColumn("yaw", "rad, heading, counter-clockwise from x"),
    TableColumn("l", "m, length, along the heading, above 0"),
    TableColumn("w", "m, width, above 0"),
    TableColumn("h", "m, height, above 0"),
)
_CLASS = TableColumn(
    "class",
    "name of a class of the task; another spelling of it, such as Car, is an error; "
    "rows of other classes are skipped and counted",
    text=True,
)
_SCORE = TableColumn("score", "score that the detector gives", "1")
_VELOCITY = tuple(
    TableColumn(name, "m/s; empty: unknown", "unknown", gaps=True, together="velocity")
    for name in ("vx", "vy")
)
_DIFFERENCES = "computed from the position in the frame before"
TABLES: dict[str, tuple[TableColumn, ...]] = {
    "truth": (
        _FRAME,
        TableColumn(
            "id", "the object: a number or a word, the same in all frames", text=True
        ),
        _CLASS,
        *_CENTRE,
        *(replace(column, without=_DIFFERENCES) for column in _VELOCITY),
        TableColumn(
            "eligible",
            "1 or 0, true or false: the object can be a prediction target",
            "1",
            flag=True,
        ),
        TableColumn(
            "neutral",
            "1 or 0, true or false: a match with the object counts neither as right "
            "nor as wrong, for example a van where only cars are scored",
            "0",
            flag=True,
        ),
        TableColumn(
            "visible",
            "visible share of the object, 0 to 1, for simulated detectors",
            "computed from the boxes",
        ),
    ),
    "detections": (_FRAME, _CLASS, *_CENTRE, _SCORE, *_VELOCITY),
    "ego": (
        _FRAME,
        TableColumn(
            "time", "s", "`frame` times the period of the task", largest=_LATEST_TIME_S
        ),
        *(TableColumn(name, "m, position of the sensors", "0") for name in "xyz"),
        TableColumn("yaw", "rad, heading of the sensors", "0"),
    ),
}
PROJECTION = tuple(f"p{row}{column}" for row in range(3) for column in range(4))
AREA = ("x_min", "y_min", "x_max", "y_max")
LABELS: dict[str, tuple[TableColumn, ...]] = {  # what of the truth is annotated
    "annotated": (
        replace(_FRAME, meaning="number of an annotated frame, a whole number"),
    ),
    "neutral_areas": tuple(
        TableColumn(name, "m, border of a rectangle without labels") for name in AREA
    ),
}
BORDERS = ("left_x", "left_y", "right_x", "right_y")
PICTURES: dict[str, tuple[TableColumn, ...]] = {  # beside those of the boxes
    "lanes": (
        TableColumn("lane", "the lane: a number or a word", text=True),
        TableColumn(
            "x",
            "m, point of the lane's middle line; the rows of a lane are in the "
            "direction of travel",
        ),
        TableColumn("y", "m, point of the lane's middle line"),
        *(
            TableColumn(
                name,
                "m, point of the lane's border beside x y",
                "1.75 m from the middle line",
                together="borders",
            )
            for name in BORDERS
        ),
        TableColumn(
            "junction",
            "1 or 0, true or false: the lane is inside a junction and drawn without "
            "borders",
            "0",
            flag=True,
        ),
        TableColumn(
            "following",
            "lanes that continue this one, separated by blanks; empty: none",
            "none",
            text=True,
            gaps=True,
        ),
    ),
    "images": (
        _FRAME,
        TableColumn("camera", "name of the camera, such as front", text=True),
        TableColumn("file", "path of the image inside the scene's folder", text=True),
        TableColumn("width", "pixels"),
        TableColumn("height", "pixels"),
        *(
            TableColumn(name, f"projection, row {name[1]}, column {name[2]}")
            for name in PROJECTION
        ),
    ),
}
TRACKS = (  # of a table of stored tracks, which is a separate file
    replace(_FRAME, meaning="number of the frame, a whole number from 0"),
    TableColumn(
        "id", "the track: a number or a word, the same in all frames", text=True
    ),
    _CLASS,
    *_CENTRE,
    replace(_SCORE, meaning="score that the tracker gives"),
    *_VELOCITY,
)
COLUMNS = {**TABLES, **LABELS, **PICTURES, "tracks": TRACKS}


MAX_FRAMES = 1_000_000
# x and y: rollouts keep boxes in single precision, which is coarser than centimetres
# farther away
MAX_COORDINATE_M = 1e5
# share by which the frame period of a scene may differ from the task's
PERIOD_TOLERANCE = 0.2
_NEAR_ORIGIN = (
    f"expected -{MAX_COORDINATE_M:g} to {MAX_COORDINATE_M:g} m: boxes are kept in "
    "single precision, so subtract a fixed origin from all coordinates, such as the "
    "first position of the ego"
)
_SIZE = (
    SMALLEST_SIDE_M,
    LIMIT,
    f"expected a number from {SMALLEST_SIDE_M:g} to {LIMIT:g}",
)
_ANY_NUMBER = (-LIMIT, LIMIT, f"expected a number from {-LIMIT:g} to {LIMIT:g}")
_PLACE = (-MAX_COORDINATE_M, MAX_COORDINATE_M, _NEAR_ORIGIN)
_RANGES = {  # column -> least, largest, message
    **dict.fromkeys(("x", "y", *BORDERS, *AREA), _PLACE),
    **dict.fromkeys(("l", "w", "h"), _SIZE),
    **dict.fromkeys(("z", "vx", "vy", "score"), _ANY_NUMBER),
    "yaw": (-MAX_ANGLE_RAD, MAX_ANGLE_RAD, RADIANS),
    "visible": (0.0, 1.0, "expected a number from 0 to 1"),
}


def scene_frames(
    where: str, tables: Mapping[str, RowTable], rate_hz: float
) -> tuple[Ints, Floats]:
    """Return numbers [F], rising, and times [F] in s of the frames.

    They are the rows of the ego table, else all numbers in use. ``rate_hz`` gives the
    times without an ego table that has them. Raises DataError.
    """
    if "ego" not in tables:
        frame_numbers = _numbers_in_use(where, tables)
        return frame_numbers, (frame_numbers - frame_numbers[0]) / rate_hz
    ego = tables["ego"]
    if not len(ego):
        raise DataError(f"{ego.source} has no rows, expected one per frame")
    frame_numbers = ego.whole_numbers("frame")
    falls = np.diff(frame_numbers, prepend=frame_numbers[0] - 1) <= 0
    ego.refuse(falls, "expected a number above that of the row before", "frame")
    if "time" in ego:
        return frame_numbers, ego["time"]
    return frame_numbers, (frame_numbers - frame_numbers[0]) / rate_hz


def _numbers_in_use(where: str, tables: Mapping[str, RowTable]) -> Ints:
    """Return the numbers [F] from the first to the last frame that has a row."""
    frames = [table.whole_numbers("frame") for table in tables.values()]
    used_frames = np.unique(np.concatenate(frames))
    if not len(used_frames):
        raise DataError(
            f"{where}: its tables have no rows; an ego table defines the frames"
        )
    frame_step = int(np.gcd.reduce(np.diff(used_frames)))
    if frame_step > 1:
        raise DataError(
            f"{where}: rows have the frames {used_frames[0]}, {used_frames[1]}, ..., "
            f"all {frame_step} apart; number them 0, 1, 2, ..., or define the frames "
            "by an ego table"
        )
    if used_frames[-1] - used_frames[0] >= MAX_FRAMES:
        raise DataError(
            f"{where}: frames {used_frames[0]} to {used_frames[-1]}, expected at most "
            f"{MAX_FRAMES} "
            "frames"
        )
    return np.arange(used_frames[0], used_frames[-1] + 1)


def frame_index(table: RowTable, frame_numbers: Ints) -> Ints:
    """Return the index of each row's frame among the ``frame_numbers`` [F] of a scene.

    Raises DataError for an unknown frame.
    """
    frame = table.whole_numbers("frame")
    index = np.minimum(np.searchsorted(frame_numbers, frame), len(frame_numbers) - 1)
    problem = (
        f"no frame of the scene, which has {frame_numbers[0]} to {frame_numbers[-1]}"
    )
    table.refuse(frame_numbers[index] != frame, problem, "frame")
    return index


def check_frames(time: Floats, ego: Floats, card: Card, where: str) -> None:
    """Raise DataError unless the frames have sound times and poses of the ego.

    Times rise with the task's period. Frames may be missing: no track or forecast
    crosses such a hole in time.
    """
    if not len(time):
        raise DataError(f"{where}: no frames, expected at least one")
    rises = (np.abs(time) < np.inf) & (np.diff(time, prepend=-np.inf) > 0)
    expected = "expected a number above that of the frame before"
    refuse(
        ~rises,
        lambda frame: f"{where}: time {time[frame]:g} of frame {frame}, {expected}",
    )
    place = ego[:, :3]
    yaw = ego[:, 3]

    def place_problem(index: int) -> str:
        frame, axis = divmod(index, 3)
        name = f"{'xyz'[axis]} of the ego in frame {frame}"
        return f"{where}: {name} is {place[frame, axis]:.10g}, {_NEAR_ORIGIN}"

    refuse(~(np.abs(place) <= MAX_COORDINATE_M).ravel(), place_problem)
    refuse(
        ~(np.abs(yaw) <= MAX_ANGLE_RAD),
        lambda frame: (
            f"{where}: yaw of the ego in frame {frame} is {yaw[frame]:g}, {RADIANS}"
        ),
    )
    _check_period(time, card, where)


def _check_period(time: Floats, card: Card, where: str) -> None:
    if len(time) < 2:
        return
    period_s = 1.0 / card.task.rate
    median_s = float(np.median(np.diff(time)))
    if abs(median_s - period_s) > PERIOD_TOLERANCE * period_s:
        raise DataError(
            f"{where}: frames are {median_s:g} s apart, but {card.id} has "
            f"{card.task.rate:g} frames per second: keep frames of that rate alone, or "
            "take a card with the rate of the scene"
        )


def check_ranges(table: RowTable, positive_sizes: bool = True) -> None:
    """Raise DataError for the first number outside of its range.

    ``positive_sizes``: sizes must be above 0, as those of true boxes.
    """
    for column, (smallest, largest, expected) in _RANGES.items():
        if column not in table:
            continue
        may_be_negative = column in ("l", "w", "h") and not positive_sizes
        low = -LIMIT if may_be_negative else smallest
        _check_range(table, column, low, largest, expected)


def _check_range(
    table: RowTable, column: str, smallest: float, largest: float, expected: str
) -> None:
    values = table[column]
    is_sound = (values >= smallest) & (values <= largest)
    if column in ("vx", "vy"):
        is_sound |= np.isnan(values)
    table.refuse(~is_sound, lambda row: f"{values[row]:.10g}, {expected}", column)


def check_objects(
    table: RowTable, frame: Ints, object_number: Ints, classes: Sequence[str]
) -> None:
    """Raise DataError for impossible objects.

    An object has two boxes in a frame or two classes of the task, or two objects have
    one place.
    """
    object_names = table["id"]
    table.refuse_second_box(frame, object_names)
    class_names = table["class"]
    used_rows = np.flatnonzero(np.isin(class_names, classes))
    refuse_shared_place(
        frame[used_rows],
        table.matrix("x y")[used_rows],
        object_names[used_rows],
        lambda row: table.where(used_rows[row]),
    )
    row_order = used_rows[np.lexsort((frame[used_rows], object_number[used_rows]))]
    same_object = np.diff(object_number[row_order]) == 0
    is_changed = np.zeros(len(class_names), dtype=bool)
    is_changed[row_order[1:]] = same_object & (
        class_names[row_order[1:]] != class_names[row_order[:-1]]
    )

    def problem(row: int) -> str:
        name = str(object_names[row])
        return (
            f"{str(class_names[row])!r}, but object {name!r} has another class before: "
            "did two objects exchange their ids?"
        )

    table.refuse(is_changed, problem, "class")
