"""The seven cameras of WILDTRACK and the pixel boxes of its annotations, to check places on the ground by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from mtp_bench.types import Floats

CAMERAS = ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3")  # in the order of ``viewNum``


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated pinhole camera, as the published, undistorted images have it."""

    intrinsic: Floats  # [3, 3] pixels
    rotation: Floats  # [3, 3] world to camera (x right, y down, z forward)
    translation: Floats  # [3] m

    def project(self, points: Floats) -> Floats:
        """Pixels ``[..., 2]`` of points ``[..., 3]`` (m, world; the ground is z = 0) in front of the camera."""
        seen = points @ self.rotation.T + self.translation
        pixels: Floats = (seen / seen[..., 2:] @ self.intrinsic.T)[..., :2]
        return pixels


def read_camera(root: Path, name: str) -> Camera:
    inner = root / f"calibrations/intrinsic_zero/intr_{name}.xml"
    outer = root / f"calibrations/extrinsic/extr_{name}.xml"
    rotation = Rotation.from_rotvec(_values(outer, "rvec")).as_matrix()
    return Camera(_values(inner, "camera_matrix").reshape(3, 3), rotation, _values(outer, "tvec") / 100)


def _values(path: Path, key: str) -> Floats:
    """Numbers of one node of OpenCV's XML, which writes them plain or inside of ``data``."""
    node = ElementTree.parse(path).find(key)
    assert node is not None
    data = node.find("data")
    return np.array(((node if data is None else data).text or "").split(), dtype=np.float64)


def read_pixel_boxes(path: Path) -> Floats:
    """Left, top, right, bottom ``[M, 7, 4]`` in pixels of the people of a frame; -1 where nobody is seen."""
    sides = ("xmin", "ymin", "xmax", "ymax")
    people = json.loads(path.read_text())
    views = [sorted(person["views"], key=lambda view: int(view["viewNum"])) for person in people]
    return np.reshape([[[view[side] for side in sides] for view in seen] for seen in views], (-1, len(CAMERAS), 4))
