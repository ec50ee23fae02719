"""Arrays and tables of rows by frame, and the legend of dimensions.

``F`` frames · ``D`` detections of a frame · ``M`` true objects of a frame · ``N``
tracks of a frame (leaves: distinct track states) · ``O`` forecast objects of a frame ·
``H`` hypotheses · ``K`` samples · ``T`` future frames · ``P`` past frames, the current
one included · ``C`` classes · ``R`` rows over all frames of a scene.

Metres, seconds, radians; right-handed frames with z up; a box is ``x y z yaw l w h``
with its centre at x y z. Rows over all frames are sorted by frame; the rows of frame t
are ``start[t]:start[t + 1]``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Bools = NDArray[np.bool_]
NO_ROWS: Ints = np.zeros(0, dtype=np.int64)  # row numbers where there is no row
# arrays of a frame, by the names of the observation space and of the action space
Observation = dict[str, NDArray[Any]]
Action = dict[str, NDArray[Any]]
RecordT = TypeVar("RecordT", bound=Any)


@dataclass(frozen=True, eq=False, repr=False)
class Ragged:
    """Rows of all frames one after the other, sorted by frame.

    Frame t has the rows ``start[t]:start[t + 1]``. A table whose columns are aligned
    with these rows is a subclass.
    """

    start: Ints  # [F + 1]

    def __repr__(self) -> str:
        rows = int(self.start[-1])
        return f"{type(self).__name__}: {rows} rows in {self.frames} frames"

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.start) - 1

    @property
    def counts(self) -> Ints:
        """Number of rows of each frame [F]."""
        return self.start[1:] - self.start[:-1]

    @property
    def frame_of_rows(self) -> Ints:
        """Frame of each row [R]."""
        return np.repeat(np.arange(self.frames), self.counts)

    def rows(self, t: int) -> slice:
        """Return the rows of frame ``t``."""
        return slice(int(self.start[t]), int(self.start[t + 1]))

    def only(self, t: int) -> Self:
        """Return the table with the rows of frame ``t``.

        The other frames are empty.
        """
        return self.select(self.frame_of_rows == t)

    def select(self, mask: Bools) -> Self:
        """Return the table of the rows in ``mask`` [R].

        Every column but ``start`` must have a value per row.
        """
        names = [column.name for column in fields(self) if column.name != "start"]
        columns = {name: getattr(self, name)[mask] for name in names}
        kept_before = starts_of(mask)  # [R + 1] selected rows before each row
        return replace(self, start=kept_before[self.start], **columns)


def starts_of(count: Sequence[int] | Ints | Bools) -> Ints:
    """Return `Ragged.start` [F + 1] from the number of rows per frame [F]."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def starts_of_sorted(frame: Ints, frames: int) -> Ints:
    """Return `Ragged.start` [F + 1] from the sorted frames of rows [R]."""
    return np.searchsorted(frame, np.arange(frames + 1))


def in_groups(count: Ints) -> tuple[Ints, Ints]:
    """Return the group of each member and its place there, of groups of ``count``."""
    group = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return group, np.arange(len(group)) - first[group]


def true_runs(mask: Bools) -> Ints:
    """Return the start of each run of True in a mask, and the end after it [n, 2]."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return edges.reshape(-1, 2)


def select(record: RecordT, rows: Ints | Bools | slice) -> RecordT:
    """Return the ``rows`` of the arrays of a dataclass; other fields stay."""
    columns: dict[str, Any] = {}
    for column in fields(record):
        value = getattr(record, column.name)
        if isinstance(value, np.ndarray):
            columns[column.name] = value[rows]
    return replace(record, **columns)


def joined(records: Sequence[RecordT]) -> RecordT:
    """Concatenate records of one class, at least one, array by array."""
    columns = {
        c.name: np.concatenate([getattr(record, c.name) for record in records])
        for c in fields(records[0])
    }
    return cast(RecordT, type(records[0])(**columns))
