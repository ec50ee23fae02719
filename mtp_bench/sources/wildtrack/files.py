"""Readers of the WILDTRACK files: annotations, MVDet's stored detections, and the calibrations of the seven cameras."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from ...errors import DataError
from ...types import Floats, Ints
from ..text import LIMIT, read_json, read_table, read_text

CAMERAS = ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3")  # in the order of ``viewNum``
GRID = 480, 1440  # cells of the annotated area along x and y
CELL = 0.025  # m
CORNER = -3.0, -9.0  # m, x and y of cell (0, 0)
_SIDES = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True, eq=False)
class Annotations:
    """People of one frame, in the order of the file."""

    person: Ints  # [M]
    place: Floats  # [M, 2] m on the ground plane
    image_box: Floats  # [M, 7, 4] left top right bottom in pixels, per camera of `CAMERAS`; NaN where not seen


@dataclass(frozen=True, eq=False)
class StoredDetections:
    """Rows of a file ``frame gx gy``."""

    line: Ints  # [R] in the file, from 1
    frame: Ints  # [R] the number of the annotation file
    place: Floats  # [R, 2] m on the ground plane


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera: pinhole with OpenCV's five distortion coefficients."""

    name: str
    intrinsic: Floats  # [3, 3] pixels
    distortion: Floats  # [5] k1 k2 p1 p2 k3
    rotation: Floats  # [3, 3] world to camera (x right, y down, z forward)
    translation: Floats  # [3] m

    def project(self, points: Floats) -> Floats:
        """Pixels ``[..., 2]`` of points ``[..., 3]`` (m, world; the ground is z = 0); NaN for those behind the camera.

        A pixel may lie outside of the image of 1920 x 1080.
        """
        seen = points @ self.rotation.T + self.translation
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        x, y = np.moveaxis(seen[..., :2] / depth, -1, 0)
        k1, k2, p1, p2, k3 = self.distortion
        square = x**2 + y**2
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        bent = [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x**2),
            y * radial + p1 * (square + 2 * y**2) + 2 * p2 * x * y,
            np.ones_like(x),
        ]
        pixels: Floats = (np.stack(bent, axis=-1) @ self.intrinsic.T)[..., :2]
        return pixels


def read_annotations(path: Path) -> Annotations:
    """People of one frame; DataError names the file and the person that is wrong."""
    content = read_json(path)
    if not isinstance(content, list):
        raise DataError(f"{path}: got {type(content).__name__}, expected a list of people")
    person, place, image_box = [], [], []
    for number, entry in enumerate(content):
        where = f"{path}, entry {number}"
        person.append(_integer(entry, "personID", where))
        where = f"{path}, person {person[-1]}"
        place.append(_place(_integer(entry, "positionID", where), where))
        image_box.append(_image_boxes(entry.get("views"), where))
    ids = np.array(person, dtype=np.int64)
    known, count = np.unique(ids, return_counts=True)
    if (count > 1).any():
        raise DataError(f"{path}: person {known[np.argmax(count > 1)]} is there twice, expected once per frame")
    return Annotations(ids, np.reshape(place, (-1, 2)), np.reshape(image_box, (-1, len(CAMERAS), 4)))


def read_detections(path: Path) -> StoredDetections:
    """Detections, rows ``frame gx gy`` on the grid of the annotations; DataError names the line that is wrong."""
    table = read_table(path, "frame gx gy")
    frame, cell = table.whole("frame"), table.value[:, 1:]
    off = np.asarray(~((cell >= 0) & (cell < GRID)).all(axis=1))  # NaN is off the grid, too
    table.refuse(off, lambda at: f"cell {cell[at, 0]:g} {cell[at, 1]:g} is off the grid of {GRID[0]} x {GRID[1]}")
    _, first, place = np.unique(table.value, axis=0, return_index=True, return_inverse=True)
    original = first[place.reshape(-1)]
    table.refuse(
        original < np.arange(len(original)),
        lambda at: f"a second detection at the place of line {table.line[original[at]]}",
    )
    return StoredDetections(table.line, frame, metres(cell))


def read_cameras(
    root: Path, intrinsics: Literal["intrinsic_zero", "intrinsic_original"] = "intrinsic_zero"
) -> tuple[Camera, ...]:
    """The seven cameras, in the order of ``viewNum``; lengths are converted from centimetres. Raises DataError.

    ``intrinsic_zero`` has no distortion: it belongs to the published (undistorted) images, and the pixel boxes of the
    annotations are projections by it. ``intrinsic_original`` belongs to the raw videos.
    """
    return tuple(_camera(root / "calibrations", intrinsics, name) for name in CAMERAS)


def metres(cell: Floats | Ints) -> Floats:
    """Places ``[..., 2]`` in metres of grid cells ``[..., 2]``."""
    return np.asarray(np.array(CORNER) + CELL * cell)


def _camera(folder: Path, intrinsics: str, name: str) -> Camera:
    from scipy.spatial.transform import Rotation

    inner, outer = folder / intrinsics / f"intr_{name}.xml", folder / "extrinsic" / f"extr_{name}.xml"
    return Camera(
        name=name,
        intrinsic=_values(inner, "camera_matrix", 9).reshape(3, 3),
        distortion=_values(inner, "distortion_coefficients", 5),
        rotation=Rotation.from_rotvec(_values(outer, "rvec", 3)).as_matrix(),
        translation=_values(outer, "tvec", 3) / 100,
    )


def _values(path: Path, key: str, count: int) -> Floats:
    """Numbers ``[count]`` of one node of OpenCV's XML, which writes them plain or inside of ``data``."""
    try:
        node = ElementTree.fromstring(read_text(path)).find(key)
    except ElementTree.ParseError as error:
        raise DataError(f"{path} is no XML: {error}") from None
    if node is None:
        raise DataError(f"{path}: no {key!r}")
    data = node.find("data")
    words = ((node if data is None else data).text or "").split()
    try:
        value = np.array(words, dtype=np.float64)
    except ValueError:
        raise DataError(f"{path}: {key!r} holds {' '.join(words)!r}, expected numbers") from None
    if len(value) != count or not (np.abs(value) <= LIMIT).all():
        raise DataError(f"{path}: {key!r} must hold {count} finite numbers up to {LIMIT:g}, got {' '.join(words)!r}")
    return value


def _place(position: int, where: str) -> Floats:
    if not 0 <= position < GRID[0] * GRID[1]:
        raise DataError(f"{where}: positionID is {position}, off the grid of {GRID[0]} x {GRID[1]} cells")
    return metres(np.array([position % GRID[0], position // GRID[0]]))


def _image_boxes(views: Any, where: str) -> Floats:
    box = np.full((len(CAMERAS), 4), np.nan)
    if not isinstance(views, list):
        raise DataError(f"{where}: no list 'views'")
    for view in views:
        number = _integer(view, "viewNum", where)
        if not 0 <= number < len(CAMERAS):
            raise DataError(f"{where}: viewNum is {number}, expected 0 to {len(CAMERAS) - 1}")
        sides = [_integer(view, key, f"{where}, view {number}") for key in _SIDES]
        if sides != [-1] * 4:
            box[number] = sides
    return box


def _integer(entry: Any, key: str, where: str) -> int:
    if not isinstance(entry, dict):
        raise DataError(f"{where}: got {reprlib.repr(entry)}, expected an object with {key!r}")
    value = entry.get(key)
    if key not in entry:
        raise DataError(f"{where}: no {key!r}")
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > LIMIT:
        raise DataError(f"{where}: {key!r} is {reprlib.repr(value)}, expected an integer up to {LIMIT:g}")
    return value
