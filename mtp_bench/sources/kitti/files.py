"""KITTI tracking in a card and in a folder, and its text files, read into arrays.

Boxes come out in the sensor frame of their own image: the rectified camera 0 with its
axes renamed to x forward (camera z), y left (-camera x), z up (-camera y).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from ...cards import Card, DetectionsSection, Traits, instead_of_stored
from ...core import DataError, Floats, Ints, MissingDataError, wrap_angle
from ..base import (
    detections_folder,
    own_detections,
    require_focal_lengths,
    section_of,
)
from ..dataset import Dataset
from ..readers import read_table
from ..tables import RowTable
from ..text import read_text

BOX_FIELDS = "height width length x y z rotation_y"  # in camera axes
LABEL = f"frame id type truncated occluded alpha left top right bottom {BOX_FIELDS}"
RESULT = f"{LABEL} score"  # of trackers and detectors, for the benchmark
DETECTION = f"frame type left top right bottom score {BOX_FIELDS} alpha"
# of the GPS/IMU unit; yaw 0 is east, counter-clockwise, and ve vn vu are m/s
OXTS = (
    "lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu "
    "pos_accuracy vel_accuracy navstat numsats posmode velmode orimode"
)
ODOMETRY = "x1 x2 x3 xt y1 y2 y3 yt z1 z2 z3 zt"
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
# tolerance of the entries of a rotation, which may have few digits
ROUNDING = 1e-2
SENSOR_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# names in files of the benchmark and of the raw data, and number of columns
_IMU_TO_CAMERA = (
    (("R_rect", "R0_rect"), 3),
    (("Tr_velo_cam", "Tr_velo_to_cam"), 4),
    (("Tr_imu_velo", "Tr_imu_to_velo"), 4),
)


@dataclass(frozen=True, eq=False)
class BoxRows:
    """Labels or detections of one sequence in the order of the file."""

    table: RowTable  # columns `LABEL`, `DETECTION` or `RESULT`
    frame: Ints  # [R]
    box: Floats  # [R, 7] sensor frame


def read_labels(path: Path) -> BoxRows:
    """Read the labels of one sequence, all types included.

    The id of DontCare is -1, and its box NaN. An empty file gives no rows. DataError
    names the line that is wrong.
    """
    table = read_table(path, LABEL, words="type")
    require_kinds(table)
    frame = table.whole_numbers("frame")
    object_id = table.whole_numbers("id")
    is_boxed = table["type"] != "DontCare"
    boxed_table = table.select(is_boxed)
    is_flat = (boxed_table.matrix("height width length") <= 0).any(axis=1)
    boxed_table.refuse(is_flat, "a box with a size that is not above 0")
    boxed_table.refuse_degrees("rotation_y")
    boxed_table.refuse_second_box(frame[is_boxed], object_id[is_boxed])
    box = sensor_boxes(table.matrix(BOX_FIELDS))
    box[~is_boxed] = np.nan
    return BoxRows(table, frame, box)


def read_detections(folder: Path, name: str, kind: str, code: int) -> BoxRows:
    """Read the detections of one sequence and class.

    ``name``: the sequence. ``kind``: type in the labels, such as "Car"; ``code``:
    AB3DMOT's number of it. An empty file gives no rows. The file lies in a folder of
    its class, as AB3DMOT's, or holds all types in the result form of KITTI's benchmark.
    Scores are raw logits. NaN and sizes that are not positive are kept. DataError names
    the line that is wrong.
    """
    if (folder / kind).is_dir():
        path = folder / kind / f"{name}.txt"
        table = read_table(path, DETECTION, ",", finite=False)
        class_code = table.whole_numbers("type")
        expected = f"expected {code} ({kind})"
        table.refuse(
            class_code != code, lambda row: f"type {class_code[row]}, {expected}"
        )
    else:
        path = folder / f"{name}.txt"
        table = read_table(path, RESULT, words="type", finite=False)
        require_kinds(table)
        table = table.select(table["type"] == kind)
    table.refuse_degrees("rotation_y")
    box = sensor_boxes(table.matrix(BOX_FIELDS))
    return BoxRows(table, table.whole_numbers("frame"), box)


def require_kinds(table: RowTable) -> None:
    """Raise DataError for the first row with a type that KITTI does not have."""
    kind = table["type"]
    expected = f"expected one of {', '.join(KINDS)}"
    table.refuse(
        ~np.isin(kind, KINDS), lambda row: f"type {str(kind[row])!r}, {expected}"
    )


def read_odometry(path: Path) -> Floats:
    """Read the poses [F, 3, 4] of a camera, which turn and shift to the world.

    The file has one row of 12 numbers per frame. The world has the camera axes of frame
    0.
    """
    table = read_frames(path, ODOMETRY)
    pose = table.matrix(ODOMETRY).reshape(-1, 3, 4)
    rotation = pose[:, :, :3]
    rotation_error = np.abs(rotation @ rotation.swapaxes(1, 2) - np.eye(3)).max(
        axis=(1, 2)
    )
    is_mirrored = np.linalg.det(rotation) < 0
    table.refuse(
        (rotation_error > ROUNDING) | is_mirrored,
        "expected a rotation in the first three columns of a 3 x 4 matrix",
    )
    return pose


def read_frames(path: Path, columns: str) -> RowTable:
    """Read the rows of one sequence, one per frame and at least one."""
    table = read_table(path, columns)
    if not len(table):
        raise DataError(f"{path} is empty, expected one row per frame")
    return table


def read_imu_to_camera(path: Path) -> Floats:
    """Read the transform [4, 4] from the GPS/IMU unit to the rectified camera 0.

    It is R_rect x Tr_velo_cam x Tr_imu_velo.
    """
    transform = np.eye(4)
    for names, columns in _IMU_TO_CAMERA:
        step = read_calibration(path, names, columns)
        rotation = step[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=ROUNDING):
            raise DataError(
                f"{path}: line {names[0]!r} must hold a rotation in its first 3 "
                "columns and finite numbers"
            )
        transform = transform @ step
    return transform


def read_camera(path: Path) -> Floats:
    """Read the projection [3, 4] of the rectified camera 2, in pixels."""
    camera = read_calibration(path, ("P2",), 4)[:3]
    require_focal_lengths(camera[None], lambda row: f"{path}, line 'P2'")
    return camera


def read_calibration(path: Path, names: tuple[str, ...], columns: int) -> Floats:
    """Read a matrix of 3 rows, completed to [4, 4] with those of a unit matrix.

    ``names``: names that its line may have; the file has one of them. ``columns``:
    number of columns in the file.
    """
    cells_of_line: dict[str, list[str]] = {}
    for line in read_text(path).splitlines():
        if line.strip():
            line_name, *line_cells = line.split()
            cells_of_line[line_name.rstrip(":")] = line_cells
    existing = [line_name for line_name in names if line_name in cells_of_line]
    if not existing:
        listed = ", ".join(cells_of_line) or "no lines"
        raise DataError(f"{path}: no line {names[0]!r}; found {listed}")
    line_cells = cells_of_line[existing[0]]
    matrix = np.eye(4)
    try:
        matrix[:3, :columns] = np.array(line_cells, dtype=np.float64).reshape(
            3, columns
        )
    except ValueError:
        raise DataError(
            f"{path}: line {names[0]!r} must hold {3 * columns} numbers, got "
            f"{len(line_cells)}"
        ) from None
    if not np.isfinite(matrix).all():
        raise DataError(f"{path}: line {names[0]!r} must hold finite numbers")
    return matrix


def read_sequence_map(path: Path) -> dict[str, int]:
    """Read the number of frames of each sequence, in the order of the file.

    Its rows are ``0001 empty 000000 000447``; empty without a file.
    """
    if not path.is_file():
        return {}
    table = read_table(path, "sequence kind first frames", words="sequence kind")
    if not len(table):
        raise DataError(
            f"{path} names no sequence, expected rows such as '0001 empty 000000 "
            "000447'"
        )
    frames = table.whole_numbers("frames")
    table.refuse(frames < 1, "expected a number of frames above 0", "frames")
    return dict(zip(table["sequence"].tolist(), frames.tolist(), strict=True))


def camera_fields(box: Floats) -> Floats:
    """Return KITTI's fields [R, 7] of boxes [R, 7] in the sensor frame.

    They are in camera axes: height width length x y z rotation_y; the inverse of
    `sensor_boxes`.
    """
    x, y, z, yaw, length, width, height = box.T
    rotation_y = wrap_angle(-yaw - np.pi / 2)
    bottom = height / 2 - z
    return np.column_stack([height, width, length, -y, bottom, x, rotation_y])


def sensor_boxes(fields: Floats) -> Floats:
    """Return boxes [R, 7] in the sensor frame of KITTI's fields [R, 7].

    The fields are in camera axes: height width length x y z rotation_y. The place x y z
    is the centre of the bottom face; the heading is (cos ry, 0, -sin ry).
    """
    height, width, length, x, y, z, rotation_y = fields.T
    yaw = wrap_angle(-rotation_y - np.pi / 2)
    return np.column_stack([z, -x, -y + height / 2, yaw, length, width, height])


SEQUENCE_MAP = "evaluate_tracking.seqmap.val"
# AB3DMOT's split, for a root without the sequence map
VALIDATION = (
    "0001",
    "0006",
    "0008",
    "0010",
    "0012",
    "0013",
    "0014",
    "0015",
    "0016",
    "0018",
    "0019",
)
# label type, detection code
KITTI_TYPES = {
    "car": ("Car", 2),
    "pedestrian": ("Pedestrian", 1),
    "cyclist": ("Cyclist", 3),
}
LABELS = "training/label_02"
IMAGES = "training/image_02"  # shown beside an event
DATASET = Dataset.of(__file__)
RENAME = (
    "; a recording of your own needs a name that no official sequence has, such as "
    "7001, in all folders"
)


class KittiSource(DetectionsSection):
    """KITTI tracking logs with stored detections."""

    splits = ("train", "val")

    detector: str = "pointrcnn"  # folder under detections/
    # False: every frame in its own camera frame, as without ego-motion compensation
    ego_motion: bool = True
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector,
            detection_file="a folder of KITTI text, one file per sequence",
            velocity_ahead=True,
            common_frame=self.ego_motion,
            view=90.0,  # of the labels' camera
        )


def split_names(root: Path, split: str) -> tuple[str, ...]:
    """Return the sequences of a split.

    Validation: those of the sequence map, if there is one; training: every other
    sequence that has labels.
    """
    validation = tuple(read_sequence_map(root / SEQUENCE_MAP)) or VALIDATION
    if split == "val":
        return validation
    labelled = {path.stem for path in (root / LABELS).glob("*.txt")}
    return tuple(sorted(labelled.difference(validation)))


def require_detector(root: Path, card: Card) -> Path:
    """Return the folder of the card's detections.

    Raises DataError unless it is complete.
    """
    own_folder = own_detections(card)
    if own_folder is not None:
        return own_folder
    folder = detections_folder(root, card, DATASET)
    detector = section_of(card, KittiSource).detector
    names = sorted(path.name for path in folder.iterdir() if path.is_dir())
    if detector not in names:
        raise MissingDataError(
            f"{folder} has no detector {detector!r}; found: "
            f"{', '.join(names) or 'none'}{instead_of_stored(card)}"
        )
    for name in card.task.classes:
        path = folder / detector / KITTI_TYPES[name][0]
        if not path.is_dir():
            raise MissingDataError(f"no folder {path}, expected for class {name!r}")
    return folder / detector
