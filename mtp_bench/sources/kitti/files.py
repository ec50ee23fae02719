"""Text files of the KITTI tracking benchmark, read into arrays.

Boxes come out in the sensor frame of their own image: the rectified camera 0 with its axes renamed to x forward
(camera z), y left (-camera x), z up (-camera y).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core import DataError, Floats, Ints, wrap_angle
from ..text import RowTable, numbered_lines, read_table

BOX_FIELDS = "height width length x y z rotation_y"  # in camera axes
LABEL = f"frame id type truncated occluded alpha left top right bottom {BOX_FIELDS}"
RESULT = f"{LABEL} score"  # of trackers and detectors, for the benchmark
DETECTION = f"frame type left top right bottom score {BOX_FIELDS} alpha"
OXTS = (
    "lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu "
    "pos_accuracy vel_accuracy navstat numsats posmode velmode orimode"
)
ODOMETRY = " ".join(f"{row}{column}" for row in "xyz" for column in "123t")
KINDS = (
    "Car",
    "Van",
    "Truck",
    "Pedestrian",
    "Person",
    "Person_sitting",
    "Cyclist",
    "Tram",
    "Misc",
    "DontCare",
)
ROUNDING = 1e-2  # of the entries of a rotation, which may have few digits
SENSOR_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class LabelRows:
    """Rows of ``label_02/%04d.txt`` in the order of the file, all types included."""

    table: RowTable  # columns `LABEL`
    frame: Ints  # [R]
    object_id: Ints  # [R] -1 for DontCare
    type: NDArray[np.str_]  # [R] one of `KINDS`
    image_box: Floats  # [R, 4] left top right bottom, pixels
    box: Floats  # [R, 7] sensor frame; NaN for DontCare


@dataclass(frozen=True, eq=False)
class DetectionRows:
    """Detections of one class in the order of the file."""

    table: RowTable  # columns `DETECTION`, or `RESULT`
    frame: Ints  # [R]
    score: Floats  # [R] raw logit
    box: Floats  # [R, 7] sensor frame; may hold NaN or sizes that are not positive


@dataclass(frozen=True, eq=False)
class Oxts:
    """Rows of ``oxts/%04d.txt``, one per frame: the GPS/IMU unit."""

    attitude: Floats  # [F, 3] roll, pitch, yaw in rad; yaw 0 is east, counter-clockwise
    velocity: Floats  # [F, 3] m/s east, north, up


def read_labels(path: Path) -> LabelRows:
    """Labels of one sequence; an empty file gives no rows. DataError names the line that is wrong."""
    table = read_table(path, LABEL, text="type")
    require_kinds(table)
    kind = table.words["type"]
    boxed = kind != "DontCare"
    table.refuse_not_finite(LABEL.replace(" type", ""))
    flat = (table.matrix("height width length") <= 0).any(axis=1)
    table.refuse(boxed & flat, "a box with a size that is not above 0")
    table.refuse_degrees("rotation_y", boxed)
    frame, object_id = table.whole("frame"), table.whole("id")
    table.refuse_second_box(frame, object_id, np.flatnonzero(boxed))
    box = sensor_boxes(table.matrix(BOX_FIELDS))
    box[~boxed] = np.nan
    return LabelRows(
        table, frame, object_id, kind, table.matrix("left top right bottom"), box
    )


def read_detections(folder: Path, name: str, kind: str, code: int) -> DetectionRows:
    """Detections of one sequence and class; an empty file gives no rows. DataError names the line that is wrong.

    They lie in a folder for each class, as of AB3DMOT, whose number of the class is ``code``, or in one file for all
    types, in the result form of KITTI's benchmark. NaN and sizes that are not positive are kept.
    """
    if (folder / kind).is_dir():
        table = read_table(folder / kind / f"{name}.txt", DETECTION, ",")
        got = table.whole("type")
        table.refuse(
            got != code, lambda row: f"type {got[row]}, expected {code} ({kind})"
        )
    else:
        every = read_table(folder / f"{name}.txt", RESULT, text="type")
        require_kinds(every)
        table = every.select(every.words["type"] == kind)
    table.refuse_degrees("rotation_y")
    return DetectionRows(
        table,
        table.whole("frame"),
        table["score"],
        sensor_boxes(table.matrix(BOX_FIELDS)),
    )


def require_kinds(table: RowTable) -> None:
    """Raise DataError for the first row with a type that KITTI does not have."""
    kind = table.words["type"]
    table.refuse(
        ~np.isin(kind, KINDS),
        lambda row: f"type {str(kind[row])!r}, expected one of {', '.join(KINDS)}",
    )


def read_oxts(path: Path) -> Oxts:
    """GPS/IMU rows of one sequence, at least one."""
    table = _rows_of_frames(path, OXTS)
    table.refuse_not_finite("lat lon alt roll pitch yaw vn ve vu")
    return Oxts(table.matrix("roll pitch yaw"), table.matrix("ve vn vu"))


def read_odometry(path: Path) -> Floats:
    """Poses ``[F, 3, 4]`` camera to world (world = camera axes of frame 0), one row of 12 numbers per frame."""
    table = _rows_of_frames(path, ODOMETRY)
    table.refuse_not_finite(ODOMETRY)
    pose = table.matrix(ODOMETRY).reshape(-1, 3, 4)
    turn = pose[:, :, :3]
    off = np.abs(turn @ turn.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) > ROUNDING
    table.refuse(
        off | (np.linalg.det(turn) < 0),
        "expected a rotation in the first three columns of a 3 x 4 matrix",
    )
    return pose


def _rows_of_frames(path: Path, columns: str) -> RowTable:
    table = read_table(path, columns)
    if not len(table):
        raise DataError(f"{path} is empty, expected one row per frame")
    return table


def read_imu_to_camera(path: Path) -> Floats:
    """Transform ``[4, 4]`` from the GPS/IMU unit to the rectified camera 0: R_rect x Tr_velo_cam x Tr_imu_velo."""
    whole = np.eye(4)
    for names in (
        ("R_rect", "R0_rect"),
        ("Tr_velo_cam", "Tr_velo_to_cam"),
        ("Tr_imu_velo", "Tr_imu_to_velo"),
    ):
        motion = read_calibration(path, names, 3 if names[0] == "R_rect" else 4)
        turn = motion[:3, :3]
        if not np.allclose(turn @ turn.T, np.eye(3), atol=ROUNDING):
            raise DataError(
                f"{path}: line {names[0]!r} must hold a rotation in its first 3 columns and finite numbers"
            )
        whole = whole @ motion
    return whole


def read_calibration(path: Path, names: tuple[str, ...], columns: int) -> Floats:
    """The matrix of 3 rows and ``columns`` under one of these names, as a part of a unit matrix ``[4, 4]``."""
    rows = {
        words[0].rstrip(":"): words[1:]
        for words in (line.split() for line in numbered_lines(path)[1])
    }
    words = next((rows[name] for name in names if name in rows), None)
    if words is None:
        raise DataError(
            f"{path}: no line {names[0]!r}; found {', '.join(rows) or 'no lines'}"
        )
    whole = np.eye(4)
    try:
        whole[:3, :columns] = np.array(words, dtype=np.float64).reshape(3, columns)
    except ValueError:
        raise DataError(
            f"{path}: line {names[0]!r} must hold {3 * columns} numbers, got {len(words)}"
        ) from None
    if not np.isfinite(whole).all():
        raise DataError(f"{path}: line {names[0]!r} must hold finite numbers")
    return whole


def read_sequence_map(path: Path) -> dict[str, int]:
    """Frames of each sequence, in the order of the file (``0001 empty 000000 000447``); empty without a file."""
    if not path.is_file():
        return {}
    rows = [line.split() for line in numbered_lines(path)[1]]
    if not rows or not all(
        len(row) == 4 and row[3].isdigit() and int(row[3]) for row in rows
    ):
        expected = "expected rows such as '0001 empty 000000 000447'"
        raise DataError(f"{path} names no sequence or has a wrong row, {expected}")
    return {row[0]: int(row[3]) for row in rows}


def camera_fields(box: Floats) -> Floats:
    """KITTI's camera-frame fields [R, 7] height width length x y z rotation_y of boxes [R, 7] in the sensor frame.

    The inverse of `sensor_boxes`.
    """
    x, y, z, yaw, length, width, height = box.T
    return np.column_stack(
        [height, width, length, -y, height / 2 - z, x, wrap_angle(-yaw - np.pi / 2)]
    )


def sensor_boxes(fields: Floats) -> Floats:
    """Boxes [R, 7] in the sensor frame of KITTI's camera-frame fields [R, 7] height width length x y z rotation_y.

    The place x y z is the centre of the bottom face; the heading is (cos ry, 0, -sin ry) in camera axes.
    """
    height, width, length, x, y, z, rotation_y = fields.T
    yaw = wrap_angle(-rotation_y - np.pi / 2)
    return np.column_stack([z, -x, -y + height / 2, yaw, length, width, height])
