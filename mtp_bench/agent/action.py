"""Table of the fields of an action.

The action space, the checks, the conformance suite, `mtp_bench.make_action` and the table of ``envs/README.md`` come
from it. Shapes are in the letters of `mtp_bench.core.arrays`.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core import ID_LIMIT, Task

COORDINATE_LIMIT = 1e5  # m, of a centre in the frame of the observations
SIZE_LIMIT = 100.0  # m, of a box
FORECAST_LIMIT = 327.0  # m, length of an offset: within int16 centimetres whichever way the frame is turned
FORECAST_REACH = float(
    math.floor(FORECAST_LIMIT / math.sqrt(2.0))
)  # m, along each axis: both are within
ABSENT = -2e30  # a log-weight below `types.ABSENT_BELOW` that lies inside the space

Rows = Literal["tracks", "hypotheses", "objects"]
ROWS: tuple[Rows, ...] = (
    "tracks",
    "hypotheses",
    "objects",
)  # in the order of `Rollout.invalid`

_KIND_NAMES = {"f": "floating", "i": "integer", "u": "integer", "b": "bool"}


@dataclass(frozen=True)
class Content:
    """Dtypes and range of the entries of a field."""

    kinds: str  # accepted kinds of dtype, in numpy's letters
    dtype: type[np.generic]  # of the action space
    expected: str  # range of the entries of a present row
    least: int = 0  # of classes


ID = Content("iu", np.int64, f"0 to {ID_LIMIT}")
BOX = Content(
    "fiu",
    np.float32,
    f"finite x y z yaw up to {COORDINATE_LIMIT:g}, l w h above 0 up to {SIZE_LIMIT:g} m",
)
CLASS = Content("iu", np.int64, "0 to C - 1")
CLASS_OR_NONE = Content("iu", np.int64, "-1 (not stated) to C - 1", least=-1)
MASK = Content("biu", np.int8, "0 or 1")
PARENT = Content("iu", np.int64, "-1 (not stated) to H - 1", least=-1)
CONFIDENCE = Content("fiu", np.float32, "0 to 1")
LOG_WEIGHT = Content("fiu", np.float32, "finite numbers, or -inf if absent")
OFFSET = Content(
    "fiu",
    np.float32,
    f"metres from the object's own centre, at most {FORECAST_LIMIT:g}",
)


@dataclass(frozen=True)
class Field:
    """One array of an action; its first axis are rows of tracks, hypotheses or objects."""

    name: str
    rows: Rows
    shape: str  # letters and numbers, as in "O K T 2"
    content: Content
    meaning: str  # one sentence
    fill: float = 0.0  # of absent rows
    optional: bool = False  # a missing field is full of ``fill``

    def shape_in(self, task: Task) -> tuple[int, ...]:
        """The shape under ``task``."""
        return _shape(
            self.shape,
            task.tracks,
            task.hypotheses,
            task.objects,
            task.samples,
            task.future,
        )

    def array_in(self, task: Task) -> str:
        """Text: shape and dtype expected under ``task``."""
        kinds = dict.fromkeys(_KIND_NAMES[kind] for kind in self.content.kinds)
        return f"an array of shape {self.shape_in(task)} and {' or '.join(kinds)} dtype"

    def values_in(self, task: Task) -> range:
        """Values of a field of classes or of parents under ``task``."""
        return range(
            self.content.least,
            task.hypotheses if self.content is PARENT else len(task.classes),
        )

    def expected_in(self, task: Task) -> str:
        """Text: entries expected under ``task``."""
        expected = self.content.expected.replace("C - 1", str(len(task.classes) - 1))
        return expected.replace("H - 1", str(task.hypotheses - 1))

    def filled(self, task: Task, rows: NDArray[Any] | None = None) -> NDArray[Any]:
        """The array under ``task`` with ``rows`` [R, ...], filled up along every axis."""
        array = np.zeros(
            self.shape_in(task), dtype=self.content.dtype
        )  # unwritten pages cost no memory
        if self.fill:
            array[...] = self.fill
        if rows is not None:
            array[tuple(slice(size) for size in rows.shape)] = rows
        return array


@lru_cache(maxsize=1024)  # asked for at every step of an env
def _shape(shape: str, *sizes: int) -> tuple[int, ...]:
    size = dict(zip("NHOKT", sizes, strict=True))
    return tuple([size[part] if part in size else int(part) for part in shape.split()])


FIELDS = (
    Field(
        "track_id",
        "tracks",
        "N",
        ID,
        "Identity of a track, the same in every frame and once per hypothesis.",
    ),
    Field("track_box", "tracks", "N 7", BOX, "Box of the track now: x y z yaw l w h."),
    Field(
        "track_class",
        "tracks",
        "N",
        CLASS_OR_NONE,
        "Class of the track.",
        fill=-1,
        optional=True,
    ),
    Field(
        "track_valid",
        "tracks",
        "N",
        MASK,
        "Rows that hold a track; the others are ignored.",
    ),
    Field(
        "hypothesis_member",
        "hypotheses",
        "H N",
        MASK,
        "Tracks of each hypothesis; hypotheses may share tracks.",
    ),
    Field(
        "hypothesis_log_weight",
        "hypotheses",
        "H",
        LOG_WEIGHT,
        "Logarithm of the hypothesis's weight, not necessarily normalised.",
        fill=-np.inf,
    ),
    Field(
        "hypothesis_parent",
        "hypotheses",
        "H",
        PARENT,
        "The hypothesis of the frame before that it descends from; else the scorer guesses it.",
        fill=-1,
        optional=True,
    ),
    Field(
        "object_box",
        "objects",
        "O 7",
        BOX,
        "Box of a forecast object now: x y z yaw l w h.",
    ),
    Field("object_class", "objects", "O", CLASS, "Class of the object."),
    Field(
        "object_valid",
        "objects",
        "O",
        MASK,
        "Rows that hold an object; the others are ignored.",
    ),
    Field(
        "object_confidence",
        "objects",
        "O",
        CONFIDENCE,
        "Probability that an object of this class is there.",
        fill=1,
        optional=True,
    ),
    Field(
        "forecast",
        "objects",
        "O K T 2",
        OFFSET,
        "Samples of the future: x y in each of the next T frames.",
    ),
    Field(
        "forecast_log_weight",
        "objects",
        "O K",
        LOG_WEIGHT,
        "Logarithm of each sample's weight, not necessarily normalised; a valid object has at least one sample.",
        fill=-np.inf,
    ),
)
FIELD = {field.name: field for field in FIELDS}


def padded(
    rows: NDArray[Any], size: int, dtype: type[np.generic], fill: float = 0
) -> NDArray[Any]:
    """The rows [R, ...], padded with ``fill`` to ``size`` rows."""
    array = np.full((size, *rows.shape[1:]), fill, dtype=dtype)
    array[: len(rows)] = rows
    return array
