"""Columns of the tables of own scenes, also for their documentation."""

from dataclasses import replace

from ..readers import TableColumn

FORMS = ("csv", "parquet")  # suffixes of tables
BOX = ("x", "y", "z", "yaw", "l", "w", "h")
# s: clocks that count from 1970 fit
_LATEST_TIME_S = 1e12

_FRAME = TableColumn("frame", "whole number of the frame")
_CENTRE = (
    TableColumn("x", "m, centre of the box"),
    TableColumn("y", "m, centre of the box"),
    TableColumn(
        "z",
        "m, centre of the box",
        "half of `h`: all objects stand on the ground, z = 0",
    ),
    TableColumn("yaw", "rad, heading, counter-clockwise from x"),
    TableColumn("l", "m, length, along the heading, above 0"),
    TableColumn("w", "m, width, above 0"),
    TableColumn("h", "m, height, above 0"),
)
_CLASS = TableColumn(
    "class",
    "name of a class of the task; rows of other classes are skipped and counted",
    text=True,
)
_SCORE = TableColumn("score", "as the detector gives it", "1")
_VELOCITY = tuple(
    TableColumn(name, "m/s; empty: unknown", "unknown", gaps=True, together="velocity")
    for name in ("vx", "vy")
)
_DIFFERENCES = "differences to the frame before"
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
            "1 or 0, true or false: can be a prediction target",
            "1",
            flag=True,
        ),
        TableColumn(
            "neutral",
            "1 or 0, true or false: a match with it counts neither as right nor as "
            "wrong, such as a van beside cars",
            "0",
            flag=True,
        ),
        TableColumn(
            "visible",
            "share in line of sight, 0 to 1, for simulated detectors",
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
BORDERS = ("left_x", "left_y", "right_x", "right_y")
PICTURES: dict[str, tuple[TableColumn, ...]] = {  # beside those of the boxes
    "lanes": (
        TableColumn("lane", "the lane: a number or a word", text=True),
        TableColumn(
            "x",
            "m, point of its middle line; the rows of a lane are in the direction of "
            "travel",
        ),
        TableColumn("y", "m, point of its middle line"),
        *(
            TableColumn(
                name,
                "m, point of a border beside x y",
                "1.75 m from the middle line",
                together="borders",
            )
            for name in BORDERS
        ),
        TableColumn(
            "junction",
            "1 or 0, true or false: inside a junction, drawn without borders",
            "0",
            flag=True,
        ),
        TableColumn(
            "following",
            "lanes that continue it, with blanks between them; empty: none",
            "none",
            text=True,
            gaps=True,
        ),
    ),
    "images": (
        _FRAME,
        TableColumn("camera", "name of the camera, such as front", text=True),
        TableColumn(
            "file", "path of the image inside of the folder of the scene", text=True
        ),
        TableColumn("width", "pixels"),
        TableColumn("height", "pixels"),
        *(
            TableColumn(name, f"projection, row {name[1]}, column {name[2]}")
            for name in PROJECTION
        ),
    ),
}
TRACKS = (  # of a table of stored tracks, which is a separate file
    replace(_FRAME, meaning="whole number of the frame, from 0"),
    TableColumn(
        "id", "the track: a number or a word, the same in all frames", text=True
    ),
    replace(
        _CLASS,
        meaning=f"{_CLASS.meaning}; a class of the task in other letters is an error",
    ),
    *_CENTRE,
    replace(_SCORE, meaning="as the tracker gives it"),
    *_VELOCITY,
)
COLUMNS = {**TABLES, **PICTURES, "tracks": TRACKS}
