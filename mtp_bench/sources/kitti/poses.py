"""Path of the KITTI car, and its left colour camera (image 2).

The poses start at the first one. The sensor frame is the rectified camera 0 with x
forward, y left, z up (see `files`). The world is level (z against gravity), has its
origin in the first sensor position and its x axis along the first heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, ImageField, Ints, Scene, unit_vectors
from ..base import CameraImage, DataRoot, section_of
from .files import (
    DATASET,
    IMAGES,
    LABELS,
    OXTS,
    RENAME,
    SENSOR_FROM_CAMERA,
    KittiSource,
    read_camera,
    read_frames,
    read_imu_to_camera,
    read_odometry,
)

FRAME_PERIOD = 0.1036
"""Seconds between images. The benchmark gives no time stamps and calls it 10 Hz; 0.1036
s makes the integrated velocities cover the distance between the GPS positions, and lets
parked cars wander least (tests/sources)."""

CAMERA = "image_02"

# Width and height of the images of each recording day, by the focal length of its
# calibration; the images are not needed. The right and bottom ends of DontCare regions
# agree: they reach exactly to these borders.
SIZES = {
    721.5377: (1242, 375),
    707.0493: (1224, 370),
    718.3351: (1238, 374),
    718.856: (1241, 376),
}
# m, length width height: medians over all labelled boxes of the type Car (17 750),
# Pedestrian (1 346) and Cyclist (529) of the ten sequences outside the validation
# split; `tests/sources/test_kitti_recordings.py` measures them again.
BOX_SIZES = {
    "car": (3.88, 1.63, 1.50),
    "pedestrian": (0.67, 0.60, 1.71),
    "cyclist": (1.65, 0.57, 1.74),
}


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the sensor frame, one per image."""

    rotation: Floats  # [F, 3, 3] sensor to world
    position: Floats  # [F, 3] m, world

    def ego(self) -> Floats:
        """Return states [F, 4]: x y z yaw of the sensor."""
        yaw = np.arctan2(self.rotation[:, 1, 0], self.rotation[:, 0, 0])
        return np.column_stack([self.position, yaw])

    def to_world(self, box: Floats, frame: Ints) -> Floats:
        """Bring boxes [R, 7] seen in ``frame`` [R] to the world.

        They stay upright.
        """
        rotation = self.rotation[frame]
        heading = np.column_stack([unit_vectors(box[:, 3]), np.zeros(len(box))])
        heading = np.einsum("rij,rj->ri", rotation, heading)
        place = np.einsum("rij,rj->ri", rotation, box[:, :3]) + self.position[frame]
        yaw = np.arctan2(heading[:, 1], heading[:, 0])
        return np.column_stack([place, yaw, box[:, 4:]])

    def to_sensor(self, box: Floats, frame: Ints) -> Floats:
        """Bring boxes [R, 7] of the world to the sensor in ``frame`` [R].

        The inverse of `to_world`.
        """
        rotation = self.rotation[frame]
        # a heading in the sensor's ground plane, whose horizontal part in the world is
        # that of the box
        shadow = unit_vectors(box[:, 3])[..., None]
        heading = np.linalg.solve(rotation[:, :2, :2], shadow)[..., 0]
        offset = (box[:, :3] - self.position[frame])[..., None]
        # solved, not transposed: odometry's matrices are rounded
        place = np.linalg.solve(rotation, offset)[..., 0]
        yaw = np.arctan2(heading[:, 1], heading[:, 0])
        return np.column_stack([place, yaw, box[:, 4:]])


def integrated_poses(
    velocity: Floats, attitude: Floats, imu_to_camera: Floats
) -> Poses:
    """Return poses from the integrated velocity and the attitude of the GPS/IMU unit.

    ``velocity`` [F, 3] m/s east, north, up; ``attitude`` [F, 3] rad; ``imu_to_camera``:
    `read_imu_to_camera`.

    Differences of latitude and longitude jitter by centimetres from frame to frame: the
    unit's samples come every 10 ms and are not those of the images. The slow drift of
    the integral does not matter within a forecast.
    """
    mean_velocity = (velocity[1:] + velocity[:-1]) / 2
    path_steps = np.cumsum(mean_velocity * FRAME_PERIOD, axis=0)
    path = np.concatenate([np.zeros((1, 3)), path_steps])
    return poses_from_imu(path, attitude, imu_to_camera)


def read_poses(root: Path, name: str) -> Poses:
    """Read the poses of one sequence.

    They come from odometry if the sequence has a file in ``poses_orbslam3``, otherwise
    from the GPS and inertial unit (OXTS). Sequence 0019 has bad GPS and needs the file.
    """
    oxts_path = root / f"training/oxts/{name}.txt"
    odometry_path = root / f"poses_orbslam3/{name}.txt"
    oxts = read_frames(oxts_path, OXTS)
    attitude = oxts.matrix("roll pitch yaw")
    imu_to_camera = read_imu_to_camera(root / f"training/calib/{name}.txt")
    if not odometry_path.is_file():
        return integrated_poses(oxts.matrix("ve vn vu"), attitude, imu_to_camera)
    odometry = read_odometry(odometry_path)
    if len(odometry) != len(oxts):
        raise DataError(
            f"{odometry_path} has {len(odometry)} rows, but {oxts_path} has "
            f"{len(oxts)}{RENAME}"
        )
    # from camera to camera axes of frame 0, levelled by the first attitude
    first_pose = poses_from_imu(np.zeros((1, 3)), attitude[:1], imu_to_camera)
    level = first_pose.rotation[0]
    rotation = level @ SENSOR_FROM_CAMERA @ odometry[:, :, :3] @ SENSOR_FROM_CAMERA.T
    return _from_first(rotation, odometry[:, :, 3] @ (level @ SENSOR_FROM_CAMERA).T)


def poses_from_imu(path: Floats, attitude: Floats, imu_to_camera: Floats) -> Poses:
    """Return poses from positions and attitudes [F, 3] of the GPS/IMU unit.

    ``path`` is east, north, up.
    """
    imu_from_sensor = np.linalg.inv(imu_to_camera)
    level_from_imu = _rotations(attitude)
    rotation = level_from_imu @ (imu_from_sensor[:3, :3] @ SENSOR_FROM_CAMERA.T)
    return _from_first(rotation, path + level_from_imu @ imu_from_sensor[:3, 3])


def _from_first(rotation: Floats, position: Floats) -> Poses:
    """Return poses in the level frame of the first one.

    ``rotation`` [F, 3, 3] and ``position`` [F, 3]: from the sensor to a level world.
    """
    yaw = np.arctan2(rotation[0, 1, 0], rotation[0, 0, 0])
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    turn_back = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Poses(
        rotation=turn_back @ rotation,
        position=(position - position[0]) @ turn_back.T,
    )


def _rotations(attitude: Floats) -> Floats:
    """Return rotations [F, 3, 3] Rz(yaw) Ry(pitch) Rx(roll) of ``attitude`` [F, 3].

    A rotation turns the axes forward, left, up into east, north, up.
    """
    # cosines and sines of roll, pitch, yaw
    cr, cp, cy = np.cos(attitude).T
    sr, sp, sy = np.sin(attitude).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), 2, 0))


def image_field(
    path: Path,
    poses: Poses,
    ego_motion: bool,
    region: Floats,
    region_start: Ints,
    classes: Sequence[str],
) -> ImageField:
    """Return the area in which the image of each frame can confirm objects.

    ``path`` of the calibration, ``poses`` of the F frames; ``ego_motion``: the scene is
    in the world, not in the sensor frame of each image; ``region`` [R, 4] and
    ``region_start`` [F + 1] of DontCare. The ground is level below the camera: that
    fits the labels better than ground that tilts with it.
    """
    camera = read_camera(path)
    ego = poses.ego()
    origin = ego[:, :3]
    heading = ego[:, 3]
    rotation = poses.rotation.swapaxes(1, 2)  # scene to sensor
    if not ego_motion:
        level_attitude = np.column_stack([np.zeros((len(heading), 2)), heading])
        rotation = rotation @ _rotations(level_attitude)
        origin = np.zeros_like(origin)
        heading = np.zeros_like(heading)
    rotation = camera[:, :3] @ SENSOR_FROM_CAMERA.T @ rotation
    shift = camera[:, 3] - np.einsum("fij,fj->fi", rotation, origin)
    # tells the recording day
    focal_length = min(SIZES, key=lambda length: abs(length - camera[0, 0]))
    return ImageField(
        projection=np.concatenate([rotation, shift[..., None]], axis=2),
        height=origin[:, 2],
        heading=heading,
        size=SIZES[focal_length],
        region=region,
        region_start=region_start,
        box_size=np.array([BOX_SIZES[name] for name in classes]),
    )


def scene_images(card: Card, data: DataRoot, scene: Scene) -> tuple[CameraImage, ...]:
    """Return the images of the frames of a sequence whose files are there."""
    root = DATASET.find(data, LABELS)
    folder = root / IMAGES / scene.name
    if scene.image is None or not folder.is_dir():
        return ()
    projection = scene.image.projection
    # every frame in its own sensor frame, which the labels are given in
    if scene.world is not None:
        path = root / f"training/calib/{scene.name}.txt"
        camera = read_camera(path)
        camera = np.column_stack([camera[:, :3] @ SENSOR_FROM_CAMERA.T, camera[:, 3]])
        projection = np.broadcast_to(camera, (scene.frames, 3, 4))
    stride = section_of(card, KittiSource).stride
    images: list[CameraImage] = []
    for frame in range(scene.frames):
        path = folder / f"{frame * stride:06d}.png"
        if path.is_file():
            size = scene.image.size
            images.append(CameraImage(frame, CAMERA, path, size, projection[frame]))
    return tuple(images)
