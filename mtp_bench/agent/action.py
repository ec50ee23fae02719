"""Table of the fields of an action.

The action space, the checks, the conformance suite, `mtp_bench.make_action` and the
table of ``envs/README.md`` come from it. Shapes are in the letters of
`mtp_bench.core.arrays`.
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
# m, length of an offset: within int16 centimetres whichever way the frame is turned
FORECAST_LIMIT = 327.0
# m, along each axis: both axes together are within the limit
FORECAST_REACH = float(math.floor(FORECAST_LIMIT / math.sqrt(2.0)))
# a log-weight below `core.ABSENT_BELOW` that lies inside the space
ABSENT_LOG_WEIGHT = -2e30

RowKind = Literal["tracks", "hypotheses", "objects"]
# in the order of `Rollout.invalid`
ROW_KINDS: tuple[RowKind, ...] = ("tracks", "hypotheses", "objects")
ContentName = Literal[
    "id", "box", "class", "mask", "parent", "confidence", "log_weight", "offset"
]
_DTYPE_NAMES = {"f": "floating", "i": "integer", "u": "integer", "b": "bool"}


@dataclass(frozen=True)
class Content:
    """Dtypes and range of the entries of a field."""

    name: ContentName
    kinds: str  # accepted kinds of dtype, in numpy's letters
    dtype: type[np.generic]  # type in the action space
    expected: str  # range of the entries of a present row
    min_value: int = 0  # least value, for classes and parents


_ID = Content("id", "iu", np.int64, f"0 to {ID_LIMIT}")
_BOX = Content(
    "box",
    "fiu",
    np.float32,
    f"finite x y z yaw up to {COORDINATE_LIMIT:g}, l w h above 0 up to {SIZE_LIMIT:g} m",
)
_CLASS = Content("class", "iu", np.int64, "0 to C - 1")
_CLASS_OR_NONE = Content(
    "class", "iu", np.int64, "-1 (not stated) to C - 1", min_value=-1
)
_MASK = Content("mask", "biu", np.int8, "0 or 1")
_PARENT = Content("parent", "iu", np.int64, "-1 (not stated) to H - 1", min_value=-1)
_CONFIDENCE = Content("confidence", "fiu", np.float32, "0 to 1")
_LOG_WEIGHT = Content(
    "log_weight", "fiu", np.float32, "finite numbers, or -inf if absent"
)
_OFFSET = Content(
    "offset",
    "fiu",
    np.float32,
    f"metres from the object's own centre, at most {FORECAST_LIMIT:g}",
)


@dataclass(frozen=True)
class ActionField:
    """One array of an action.

    Its first axis are rows of tracks, hypotheses or objects.
    """

    name: str
    rows: RowKind
    shape: str  # letters and numbers, as in "O K T 2"
    content: Content
    meaning: str  # one sentence
    fill: float = 0.0  # value of absent rows
    optional: bool = False  # a missing field is full of ``fill``

    def shape_in(self, task: Task) -> tuple[int, ...]:
        """Return the shape under ``task``."""
        return _shape_of(
            self.shape,
            task.tracks,
            task.hypotheses,
            task.objects,
            task.samples,
            task.future,
        )

    def array_in(self, task: Task) -> str:
        """Describe the shape and dtype expected under ``task``."""
        names = dict.fromkeys(_DTYPE_NAMES[kind] for kind in self.content.kinds)
        return f"an array of shape {self.shape_in(task)} and {' or '.join(names)} dtype"

    def values_in(self, task: Task) -> range:
        """Return the values of a field of classes or parents."""
        count = len(task.classes)
        if self.content.name == "parent":
            count = task.hypotheses
        return range(self.content.min_value, count)

    def expected_in(self, task: Task) -> str:
        """Describe the entries expected under ``task``."""
        expected = self.content.expected.replace("C - 1", str(len(task.classes) - 1))
        return expected.replace("H - 1", str(task.hypotheses - 1))

    def filled(self, task: Task, rows: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return the array under ``task`` with ``rows`` [R, ...], filled up."""
        # unwritten pages of zeros cost no memory
        array = np.zeros(self.shape_in(task), dtype=self.content.dtype)
        if self.fill:
            array[...] = self.fill
        if rows is not None:
            array[tuple(slice(size) for size in rows.shape)] = rows
        return array


@lru_cache(maxsize=1024)  # asked for at every step of an env
def _shape_of(shape: str, *sizes: int) -> tuple[int, ...]:
    """Return the numbers of a shape, given the sizes for N, H, O, K and T."""
    size_of_letter = dict(zip("NHOKT", sizes, strict=True))
    return tuple([size_of_letter.get(part) or int(part) for part in shape.split()])


ACTION_FIELDS = (
    ActionField(
        "track_id",
        "tracks",
        "N",
        _ID,
        "Identity of a track, the same in every frame and once per hypothesis.",
    ),
    ActionField(
        "track_box", "tracks", "N 7", _BOX, "Box of the track now: x y z yaw l w h."
    ),
    ActionField(
        "track_class",
        "tracks",
        "N",
        _CLASS_OR_NONE,
        "Class of the track.",
        fill=-1,
        optional=True,
    ),
    ActionField(
        "track_valid",
        "tracks",
        "N",
        _MASK,
        "Rows that hold a track; the others are ignored.",
    ),
    ActionField(
        "hypothesis_member",
        "hypotheses",
        "H N",
        _MASK,
        "Tracks of each hypothesis; hypotheses may share tracks.",
    ),
    ActionField(
        "hypothesis_log_weight",
        "hypotheses",
        "H",
        _LOG_WEIGHT,
        "Logarithm of the hypothesis's weight, not necessarily normalised.",
        fill=-np.inf,
    ),
    ActionField(
        "hypothesis_parent",
        "hypotheses",
        "H",
        _PARENT,
        "The hypothesis of the frame before that it descends from; "
        "else the scorer guesses it.",
        fill=-1,
        optional=True,
    ),
    ActionField(
        "object_box",
        "objects",
        "O 7",
        _BOX,
        "Box of a forecast object now: x y z yaw l w h.",
    ),
    ActionField("object_class", "objects", "O", _CLASS, "Class of the object."),
    ActionField(
        "object_valid",
        "objects",
        "O",
        _MASK,
        "Rows that hold an object; the others are ignored.",
    ),
    ActionField(
        "object_confidence",
        "objects",
        "O",
        _CONFIDENCE,
        "Probability that an object of this class is there.",
        fill=1,
        optional=True,
    ),
    ActionField(
        "forecast",
        "objects",
        "O K T 2",
        _OFFSET,
        "Samples of the future: x y in each of the next T frames.",
    ),
    ActionField(
        "forecast_log_weight",
        "objects",
        "O K",
        _LOG_WEIGHT,
        "Logarithm of each sample's weight, not necessarily normalised; "
        "a valid object has at least one sample.",
        fill=-np.inf,
    ),
)
FIELD_BY_NAME = {field.name: field for field in ACTION_FIELDS}


def pad_rows(
    rows: NDArray[Any], size: int, dtype: type[np.generic], fill: float = 0
) -> NDArray[Any]:
    """Pad the rows [R, ...] with ``fill`` to ``size`` rows."""
    array = np.full((size, *rows.shape[1:]), fill, dtype=dtype)
    array[: len(rows)] = rows
    return array
