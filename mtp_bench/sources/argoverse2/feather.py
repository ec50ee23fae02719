"""Feather files of Argoverse 2 with their boxes and poses; an error names the file, the row and the column."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ...core import DataError, Floats, Ints, MissingDataError, nearest, open_regular
from ..files.columns import TableColumn
from ..files.table import add_column
from ..nuscenes.tables import require_rotations, yaw_of
from ..text import RowTable

ANNOTATIONS = "annotations.feather"
TIME = "timestamp_ns"
PLACE = "tx_m ty_m tz_m"
ROTATION = "qw qx qy qz"
SIZE = "length_m width_m height_m"
BOX = f"{PLACE} {SIZE} {ROTATION}"
RATE = 10.0  # Hz of the sweeps, nominal
SECOND = 1e9  # nanoseconds
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])


def read_feather(
    path: Path, numbers: str, words: str = "", log: str = ""
) -> tuple[RowTable, Ints]:
    """The named columns of a file, blanks between them, and its times [R] in ns; ``log``: the rows of that log alone.

    Raises DataError for a file, column or cell that is wrong.
    """
    import pyarrow
    from pyarrow import compute, feather

    try:
        with open_regular(path) as stream:
            content = feather.read_table(stream)
    except FileNotFoundError:
        raise MissingDataError(f"no file {path}") from None
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise DataError(f"{path} cannot be read as Feather: {error}") from None
    for name in (TIME, *numbers.split(), *words.split(), *["log_id"] * bool(log)):
        if name not in content.column_names:
            raise DataError(
                f"{path}: no column {name!r}{nearest(name, content.column_names)}"
            )
    row = np.arange(content.num_rows)
    if log:
        mine = compute.equal(content["log_id"].cast("string"), log).fill_null(False)
        content, row = content.filter(mine), row[mine.to_numpy()]
    table = RowTable(str(path), "row", row + 1, {}, {})
    for name in numbers.split():
        add_column(table, TableColumn(name, ""), content[name])
    for name in words.split():
        add_column(table, TableColumn(name, "", text=True), content[name])
    kind = content[TIME].type
    if not pyarrow.types.is_integer(kind):
        raise DataError(
            f"{path}: column {TIME!r} is {kind}, expected int64: a float does not hold each nanosecond"
        )
    table.refuse(
        content[TIME].is_null().to_numpy(), "an empty cell, expected a number", TIME
    )
    return table, content[TIME].cast("int64").to_numpy()


def rotations(table: RowTable) -> Floats:
    """Unit quaternions [R, 4]; raises DataError for one that is not of norm 1."""
    rotation = table.matrix(ROTATION)
    require_rotations(rotation, table.where)
    return np.asarray(rotation / np.linalg.norm(rotation, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Times of all sweeps of a log, those that are frames of the scene, and the pose of the ego in each."""

    folder: Path  # of the log
    stamp: Ints  # [S] ns, increasing
    stride: int
    rotation: Floats  # [S, 4] unit quaternions w x y z, from the ego frame to the city
    place: Floats  # [S, 3] m, of the ego less the origin
    origin: Floats  # [3] m in the city: whole metres near the first pose

    @classmethod
    def read(cls, folder: Path, stride: int) -> Self:
        """Sweeps of the annotations of a log; the pose of each is that of exactly the same time."""
        stamp = np.unique(read_feather(folder / ANNOTATIONS, "")[1])
        if not len(stamp):
            raise DataError(
                f"{folder / ANNOTATIONS} has no rows, expected the boxes of a log"
            )
        path = folder / "city_SE3_egovehicle.feather"
        table, time = read_feather(path, f"{ROTATION} {PLACE}")
        known, first = np.unique(time, return_index=True)
        lost = np.setdiff1d(stamp, known)
        if len(lost):
            raise DataError(
                f"{path} has no pose at {TIME} {lost[0]}, expected one for each sweep of the annotations"
            )
        place, row = table.matrix(PLACE), first[np.searchsorted(known, stamp)]
        origin = np.round(place[first[0]])
        return cls(
            folder, stamp, stride, rotations(table)[row], place[row] - origin, origin
        )

    @property
    def time(self) -> Floats:
        """Seconds [F] of the frames since the first one."""
        return np.asarray((self.stamp[:: self.stride] - self.stamp[0]) / SECOND)

    @property
    def ego(self) -> Floats:
        """Ego x y z yaw [F, 4] in the frames."""
        return np.column_stack([self.place, yaw_of(self.rotation)])[:: self.stride]

    def frame_of(self, table: RowTable, stamp: Ints) -> Ints:
        """Frame [R] of rows at the times ``stamp`` [R], -1 for a sweep between two frames.

        Raises DataError for a time at which there is no sweep.
        """
        sweep = np.minimum(np.searchsorted(self.stamp, stamp), len(self.stamp) - 1)
        expected = f"expected a sweep of the log {self.folder.name}, by its annotations"
        table.refuse(
            self.stamp[sweep] != stamp, lambda row: f"{stamp[row]}, {expected}", TIME
        )
        return np.where(sweep % self.stride == 0, sweep // self.stride, -1)

    def boxes(self, table: RowTable, frame: Ints) -> Floats:
        """Boxes x y z yaw l w h of rows in the frames ``frame`` [R], in the city less the origin."""
        rotation, place = (
            self.rotation[frame * self.stride],
            self.place[frame * self.stride],
        )
        yaw = yaw_of(product(rotation, rotations(table)))
        return np.column_stack(
            [turned(rotation, table.matrix(PLACE)) + place, yaw, table.matrix(SIZE)]
        )

    def to_ego(self, frame: Ints, box: Floats) -> tuple[Floats, Floats]:
        """Places [R, 3] and quaternions [R, 4] in the ego frame of boxes [R, 7]: the inverse of `boxes`."""
        back, half, none = (
            self.rotation[frame * self.stride] * _INVERSE,
            box[:, 3] / 2,
            np.zeros(len(box)),
        )
        upright = np.column_stack([np.cos(half), none, none, np.sin(half)])
        return turned(back, box[:, :3] - self.place[frame * self.stride]), product(
            back, upright
        )


def product(first: Floats, second: Floats) -> Floats:
    """Quaternions [R, 4] of the rotation ``second`` and then ``first``."""
    w, v, x, u = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    return np.hstack(
        [w * x - (v * u).sum(axis=1, keepdims=True), w * u + x * v + np.cross(v, u)]
    )


def turned(rotation: Floats, vector: Floats) -> Floats:
    """Vectors [R, 3] turned by unit quaternions [R, 4]."""
    axis = rotation[:, 1:]
    half = np.cross(axis, vector)
    return vector + 2 * (rotation[:, :1] * half + np.cross(axis, half))
