"""Images of KITTI's left colour camera (image 2), where they are there."""

from __future__ import annotations

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from ..base import DataRoot, section_of
from ..images import CameraImage
from .files import SENSOR_FROM_CAMERA, read_calibration
from .layout import DATASET, IMAGES, LABELS
from .section import KittiSource

CAMERA = "image_02"


def scene_images(card: Card, data: DataRoot, scene: Scene) -> tuple[CameraImage, ...]:
    """The images of the frames of a sequence whose files are there."""
    section, root = section_of(card, KittiSource), DATASET.find(data, LABELS)
    folder = root / IMAGES / scene.name
    if scene.image is None or not folder.is_dir():
        return ()
    projection = scene.image.projection
    if scene.world is not None:  # every frame in its own sensor frame, which the labels are given in
        camera = read_calibration(root / f"training/calib/{scene.name}.txt", ("P2",), 4)[:3]
        projection = np.broadcast_to(_from_sensor(camera), (scene.frames, 3, 4))
    paths = [folder / f"{t * section.stride:06d}.png" for t in range(scene.frames)]
    return tuple(
        CameraImage(t, CAMERA, path, scene.image.size, projection[t]) for t, path in enumerate(paths) if path.is_file()
    )


def _from_sensor(camera: Floats) -> Floats:
    """The projection ``camera`` [3, 4] of camera axes, for places in the sensor frame."""
    return np.column_stack([camera[:, :3] @ SENSOR_FROM_CAMERA.T, camera[:, 3]])
