"""The left colour camera of KITTI (image 2): which objects its labels can confirm, and its images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, ImageField, Ints, Scene
from ..base import CameraImage, DataRoot, section_of
from .files import SENSOR_FROM_CAMERA, read_calibration
from .layout import DATASET, IMAGES, LABELS, KittiSource
from .poses import Poses

CAMERA = "image_02"

# Width and height of the images of each recording day, by the focal length of its calibration; the images are not
# needed. The right and bottom ends of DontCare regions agree: they reach exactly to these borders.
SIZES = {721.5377: (1242, 375), 707.0493: (1224, 370), 718.3351: (1238, 374), 718.856: (1241, 376)}
_SAME = 1.0  # pixels between the focal lengths of one camera in two calibrations
# m, length width height: medians over all labelled boxes of the type Car (17 750), Pedestrian (1 346) and Cyclist (529)
# of the ten sequences outside the validation split; `tests/sources/test_kitti_recordings.py` measures them again.
BOX_SIZES = {"car": (3.88, 1.63, 1.50), "pedestrian": (0.67, 0.60, 1.71), "cyclist": (1.65, 0.57, 1.74)}


def known_camera(path: Path) -> bool:
    """True if a calibration is of one of KITTI's cameras, whose images have a known size."""
    try:
        focal = read_calibration(path, ("P2",), 4)[0, 0]
    except DataError:  # of the GPS/IMU unit alone
        return False
    return bool(min(abs(known - focal) for known in SIZES) <= _SAME)


def image_field(
    path: Path, poses: Poses, ego_motion: bool, region: Floats, region_start: Ints, classes: Sequence[str]
) -> ImageField:
    """Area in which the image of each frame of a scene can confirm objects.

    ``path`` of the calibration, ``poses`` of the F frames, ``region`` [R, 4] and ``region_start`` [F + 1] of DontCare.
    The ground lies level below the camera also where every frame has its own frame of reference: gravity is known from
    the pose, and level ground fits the labels better than ground that tilts with the camera.
    """
    camera = read_calibration(path, ("P2",), 4)[:3]
    state = poses.ego()
    origin, heading = state[:, :3], state[:, 3]
    turn = poses.rotation.swapaxes(1, 2)  # scene to sensor
    if not ego_motion:
        turn, origin, heading = turn @ _about_z(heading), np.zeros_like(origin), np.zeros_like(heading)
    turn = camera[:, :3] @ SENSOR_FROM_CAMERA.T @ turn
    shift = camera[:, 3] - np.einsum("fij,fj->fi", turn, origin)
    focal = min(SIZES, key=lambda known: abs(known - camera[0, 0]))
    return ImageField(
        projection=np.concatenate([turn, shift[..., None]], axis=2),
        height=origin[:, 2],
        heading=heading,
        size=SIZES[focal],
        region=region,
        region_start=region_start,
        box_size=np.array([BOX_SIZES[name] for name in classes]),
    )


def _about_z(yaw: Floats) -> Floats:
    """Rotations [F, 3, 3] by ``yaw`` [F] about z."""
    cos, sin, zero, one = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw), np.ones_like(yaw)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)


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
