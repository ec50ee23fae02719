"""Argoverse 2 in a card and in a folder, and its Feather files.

An error names the file, the row and the column.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Self

import numpy as np
from pydantic import Field

from ...cards import STORED_DETECTOR, Card, DetectionsSection, Traits
from ...core import DataError, Floats, Ints, nearest, open_regular, toml_beside
from ..base import DataRoot, own_detections, section_of
from ..dataset import Dataset
from ..readers import TableColumn, add_column
from ..rotation import multiply, require_rotations, rotate_vectors, yaw_of
from ..tables import RowTable
from ..text import reading

LOGS = "sensor/*"  # folders of the splits
DETECTIONS = "detections/*.feather"
DATASET = Dataset.of(__file__)
NEUTRAL = "neutral "  # before the class that a detector reports
# official -> class, neutral or skipped
CATEGORIES: Mapping[str, str] = MappingProxyType(
    toml_beside(__file__, "categories.toml")
)
_REPORTED = [label.removeprefix(NEUTRAL) for label in CATEGORIES.values()]
CLASSES = tuple(dict.fromkeys(name for name in _REPORTED if name != "skipped"))


class Argoverse2Source(DetectionsSection):
    """Argoverse 2 sensor logs with real boxes where a file of detections has the log.

    Elsewhere the detections are simulated, by the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    # of the files of detections: one whose settings agents know, a hyphen and a word;
    # None: simulated everywhere
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] | None = "megvii-av2"
    stride: Annotated[int, Field(ge=1, le=20)] = 5  # keep every n-th sweep of 10 Hz
    # m from the ego: what lies beyond is neither true nor detected
    reach: Annotated[float, Field(gt=0, le=300)] = 60.0
    # least score in ``detections/``; a file that is named has its own
    min_detection_score: float = 0.1

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="" if self.detections_sha256 else "most of Argoverse 2",
            mixed_detections=True,
            detection_file="a .feather file in the form of Argoverse 2's detection "
            "submission",
            lanes=True,
        )


def log_folders(root: Path, split: str) -> dict[str, Path]:
    """Return the folders of the logs of a split by name.

    Raises DataError without logs.
    """
    folder = root / "sensor" / split
    paths = sorted(folder.glob("*/annotations.feather"))
    if not paths:
        annotation_files = root.glob(f"{LOGS}/*/annotations.feather")
        splits = sorted({path.parents[1].name for path in annotation_files})
        raise DataError(
            f"{folder} has no folder with annotations.feather; splits with logs: "
            f"{', '.join(splits) or 'none'}"
        )
    return {path.parent.name: path.parent for path in paths}


def detection_files(root: Path, card: Card) -> tuple[Path, ...]:
    """Return the files of detections of the card.

    They are the one that it names, else all that there are; none for simulated ones.
    """
    own_file = own_detections(card)
    if own_file is not None:
        return (own_file,)
    if not section_of(card, Argoverse2Source).detector:
        return ()
    return tuple(sorted(root.glob(DETECTIONS)))


def log_folder(card: Card, data: DataRoot, log: str) -> Path:
    """Return the folder of a log of the card's split."""
    return log_folders(DATASET.find(data, LOGS), card.source.split)[log]


ANNOTATIONS = "annotations.feather"
TIME = "timestamp_ns"
PLACE = "tx_m ty_m tz_m"
ROTATION = "qw qx qy qz"
SIZE = "length_m width_m height_m"
BOX = f"{PLACE} {SIZE} {ROTATION}"
RATE_HZ = 10.0  # of the sweeps, nominal
SECOND_NS = 1e9
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # inverts a unit quaternion


def read_feather(
    path: Path, numbers: str, words: str = "", log: str = ""
) -> tuple[RowTable, Ints]:
    """Read the named columns of a file, and its times [R] in ns.

    ``numbers`` and ``words``: names of columns, blanks between them. ``log``: read only
    the rows of that log. Raises DataError for a file, column or cell that is wrong.
    """
    from pyarrow import compute, feather, types

    table_columns = [TableColumn(name) for name in numbers.split()]
    table_columns += [TableColumn(name, text=True) for name in words.split()]
    column_names = f"{TIME} {numbers} {words}".split()
    if log:
        column_names.append("log_id")
    with reading(path, "Feather"), open_regular(path) as stream:
        cells = feather.read_table(stream)
    for name in column_names:
        if name not in cells.column_names:
            known_names = nearest(name, cells.column_names)
            raise DataError(f"{path}: no column {name!r}{known_names}")
    row_numbers = np.arange(1, cells.num_rows + 1)
    if log:
        of_log = compute.equal(cells["log_id"].cast("string"), log).fill_null(False)
        cells = cells.filter(of_log)
        row_numbers = row_numbers[of_log.to_numpy()]
    table = RowTable(str(path), "row", row_numbers, {})
    for column in table_columns:
        add_column(table, column, cells[column.name])
    row_time = cells[TIME]
    if not types.is_integer(row_time.type):
        raise DataError(
            f"{path}: column {TIME!r} is {row_time.type}, expected int64: a float "
            "does not hold each nanosecond"
        )
    problem = "an empty cell, expected a number"
    table.refuse(row_time.is_null().to_numpy(), problem, TIME)
    return table, row_time.cast("int64").to_numpy()


def rotations(table: RowTable) -> Floats:
    """Return unit quaternions [R, 4].

    Raises DataError for one that is not of norm 1.
    """
    rotation = table.matrix(ROTATION)
    require_rotations(rotation, table.where)
    return np.asarray(rotation / np.linalg.norm(rotation, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Times of all sweeps of a log, the frames among them, and the poses of the ego."""

    folder: Path  # folder of the log
    stamp: Ints  # [S] ns, increasing
    stride: int  # sweeps per frame of the scene
    # [S, 4] unit quaternions w x y z, from the ego frame to the city
    rotation: Floats
    place: Floats  # [S, 3] m, of the ego less the origin
    origin: Floats  # [3] m in the city: whole metres near the first pose

    @classmethod
    def read(cls, folder: Path, stride: int) -> Self:
        """Read the sweeps of the annotations of a log with their poses."""
        annotations = folder / ANNOTATIONS
        stamp = np.unique(read_feather(annotations, "")[1])
        if not len(stamp):
            raise DataError(f"{annotations} has no rows, expected the boxes of a log")
        path = folder / "city_SE3_egovehicle.feather"
        table, time = read_feather(path, f"{ROTATION} {PLACE}")
        pose_time, first_row = np.unique(time, return_index=True)
        missing_times = np.setdiff1d(stamp, pose_time)
        if len(missing_times):
            raise DataError(
                f"{path} has no pose at {TIME} {missing_times[0]}, expected one for "
                "each "
                "sweep of the annotations"
            )
        pose_rows = first_row[np.searchsorted(pose_time, stamp)]
        pose_place = table.matrix(PLACE)
        origin = np.round(pose_place[first_row[0]])
        rotation = rotations(table)[pose_rows]
        return cls(
            folder, stamp, stride, rotation, pose_place[pose_rows] - origin, origin
        )

    @property
    def time(self) -> Floats:
        """Seconds [F] of the frames since the first one."""
        return np.asarray((self.stamp[:: self.stride] - self.stamp[0]) / SECOND_NS)

    @property
    def ego(self) -> Floats:
        """Ego x y z yaw [F, 4] in the frames."""
        return np.column_stack([self.place, yaw_of(self.rotation)])[:: self.stride]

    def frame_of(self, table: RowTable, stamp: Ints) -> Ints:
        """Return the frame [R] of rows at the times ``stamp`` [R].

        It is -1 for a sweep between two frames. Raises DataError for a time at which
        there is no sweep.
        """
        sweep = np.minimum(np.searchsorted(self.stamp, stamp), len(self.stamp) - 1)
        expected = f"expected a sweep of the log {self.folder.name}, by its annotations"
        table.refuse(
            self.stamp[sweep] != stamp, lambda row: f"{stamp[row]}, {expected}", TIME
        )
        return np.where(sweep % self.stride == 0, sweep // self.stride, -1)

    def boxes(self, table: RowTable, frame: Ints) -> Floats:
        """Return boxes x y z yaw l w h of rows in the frames ``frame`` [R].

        Coordinates are those of the city, minus the origin.
        """
        rotation = self.rotation[frame * self.stride]
        place = rotate_vectors(rotation, table.matrix(PLACE))
        place = place + self.place[frame * self.stride]
        yaw = yaw_of(multiply(rotation, rotations(table)))
        return np.column_stack([place, yaw, table.matrix(SIZE)])

    def to_ego(self, frame: Ints, box: Floats) -> tuple[Floats, Floats]:
        """Return centres [R, 3] and quaternions [R, 4] of boxes in the ego frame.

        ``box`` [R, 7] is in the frame of the scene. This inverts `boxes`.
        """
        sweep = frame * self.stride
        inverse = self.rotation[sweep] * _CONJUGATE
        yaw_rotation = np.zeros((len(box), 4))
        yaw_rotation[:, 0] = np.cos(box[:, 3] / 2)
        yaw_rotation[:, 3] = np.sin(box[:, 3] / 2)
        place = rotate_vectors(inverse, box[:, :3] - self.place[sweep])
        return place, multiply(inverse, yaw_rotation)
