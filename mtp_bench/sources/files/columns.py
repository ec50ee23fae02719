"""Columns of the tables, and arrays of the NPZ files, that hold own scenes: reading, writing and docs go by them."""

from __future__ import annotations

from dataclasses import dataclass, replace

FORMS = ("csv", "parquet")  # of tables, by suffix
BOX = ("x", "y", "z", "yaw", "l", "w", "h")


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    name: str
    meaning: str
    without: str = ""  # what happens where it is left out; empty: it has to be there
    text: bool = False  # a word, not a number
    gaps: bool = False  # a cell may be empty
    flag: bool = False  # 1 or 0; true and false are read too


_FRAME = Column("frame", "whole number of the frame", "the row's `time` says it")
_TIME = Column("time", "s", "`frame` times the period of the task")
_PLACE = (
    Column("x", "m, centre of the box"),
    Column("y", "m, centre of the box"),
    Column("z", "m, centre of the box", "half of `h`: everything stands on the ground, z = 0"),
    Column("yaw", "rad, heading, counter-clockwise from x"),
    Column("l", "m, length, along the heading, above 0"),
    Column("w", "m, width, above 0"),
    Column("h", "m, height, above 0"),
)
_CLASS = Column("class", "name of a class of the task; rows of other classes are left out, and counted", text=True)
_BACKWARD = "backward differences, which hold nothing of the future"
_SCORE = Column("score", "as the detector gives it", "1")
_VELOCITY = tuple(Column(name, "m/s; empty: unknown", "unknown", gaps=True) for name in ("vx", "vy"))
TABLES: dict[str, tuple[Column, ...]] = {
    "truth": (
        _FRAME,
        _TIME,
        Column("id", "the object: a number or a word, the same in all frames", text=True),
        _CLASS,
        *_PLACE,
        *(replace(column, without=_BACKWARD) for column in _VELOCITY),
        Column("eligible", "1 or 0, true or false: may be a prediction target", "1", flag=True),
        Column(
            "neutral",
            "1 or 0, true or false: matching it is neither right nor wrong, such as a van beside cars",
            "0",
            flag=True,
        ),
        Column("visible", "share in line of sight, 0 to 1, for simulated detectors", "worked out from the boxes"),
    ),
    "detections": (
        _FRAME,
        _TIME,
        _CLASS,
        *_PLACE,
        _SCORE,
        *_VELOCITY,
    ),
    "ego": (
        _FRAME,
        _TIME,
        *(Column(name, "m, place of the sensors", "0") for name in "xyz"),
        Column("yaw", "rad, heading of the sensors", "0"),
    ),
}
_KNOWN = replace(_CLASS, meaning=f"{_CLASS.meaning}; one of the task's in other letters is an error")
TRACKS = (  # of a table of stored tracks, which is a file of its own
    Column("frame", "whole number of the frame, from 0"),
    Column("id", "the track: a number or a word, the same in all frames", text=True),
    _KNOWN,
    *_PLACE,
    replace(_SCORE, meaning="as the tracker gives it"),
    *_VELOCITY,
)
COLUMNS = {**TABLES, "tracks": TRACKS}


@dataclass(frozen=True)
class Array:
    """An array of an NPZ file."""

    name: str
    shape: tuple[str | int, ...]  # a letter stands for one length throughout the file
    meaning: str
    kind: str = "number"  # number, whole, flag or text
    needed: bool = False


def _of_rows(table: str, letter: str, *further: Array) -> tuple[Array, ...]:
    return (
        Array(f"{table}_frame", (letter,), "the frame of each row, from 0", "whole", needed=True),
        Array(f"{table}_box", (letter, 7), "m and rad: x y z yaw l w h", needed=True),
        Array(f"{table}_class", (letter,), "name of the class", "text", needed=True),
        Array(f"{table}_velocity", (letter, 2), "m/s, NaN: unknown"),
        *further,
    )


ARRAYS = (
    Array("time", ("F",), "s, rising", needed=True),
    Array("ego", ("F", 4), "m and rad: x y z yaw of the sensors"),
    *_of_rows(
        "truth",
        "R",
        Array("truth_id", ("R",), "the object, the same in all frames", "whole", needed=True),
        Array("truth_eligible", ("R",), "may be a prediction target", "flag"),
        Array("truth_neutral", ("R",), "matching it is neither right nor wrong", "flag"),
        Array("truth_visible", ("R",), "share in line of sight, 0 to 1"),
    ),
    *_of_rows("detections", "D", Array("detections_score", ("D",), "as the detector gives it")),
    Array("world", ("F", 4), "m and rad: each frame's origin, where every frame has its own"),
    Array("said", (), "JSON: further fields of the scene, as `save_scene` writes them", "text"),
    Array("image_projection", ("F", 3, 4), "from the scene to pixels, where labels are of a camera's image"),
    Array("image_height", ("F",), "m, z of the camera"),
    Array("image_heading", ("F",), "rad, yaw of the platform"),
    Array("image_size", (2,), "pixels, width and height", "whole"),
    Array("image_region", ("G", 4), "pixels, left top right bottom, where labels do not care"),
    Array("image_region_frame", ("G",), "the frame of each region", "whole"),
    Array("image_classes", ("C",), "names of the classes of `image_box_size`", "text"),
    Array("image_box_size", ("C", 3), "m, l w h that stand for an object of each class"),
    Array("lane_of", ("L",), "the lane of each point", "whole"),
    Array("lane_points", ("L", 3, 2), "m, centre, left and right border"),
    Array("lane_following", ("E", 2), "a lane and one that continues it", "whole"),
    Array("lane_junction", ("J",), "of each lane, whether it is a way through a junction", "flag"),
)
