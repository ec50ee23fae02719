"""Path of the KITTI car: poses of its sensor frame in a world that starts at the first one.

The sensor frame is the rectified camera 0 with x forward, y left, z up (see `files`). The world is level
(z against gravity), has its origin in the first sensor position and its x axis along the first heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Floats, Ints
from .files import SENSOR_FROM_CAMERA, Oxts

FRAME_PERIOD = 0.1036
"""Seconds between images. The benchmark gives no time stamps and calls it 10 Hz; 0.1036 s makes the integrated
velocities cover the distance between the GPS positions, and lets parked cars wander least (tests/sources)."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the sensor frame, one per image."""

    rotation: Floats  # [F, 3, 3] sensor to world
    position: Floats  # [F, 3] m, world

    def ego(self) -> Floats:
        """States ``[F, 4]``: x y z yaw of the sensor."""
        yaw = np.arctan2(self.rotation[:, 1, 0], self.rotation[:, 0, 0])
        return np.column_stack([self.position, yaw])

    def to_world(self, box: Floats, frame: Ints) -> Floats:
        """Boxes ``[R, 7]`` seen in ``frame [R]``, brought to the world, where they stay upright."""
        rotation = self.rotation[frame]
        heading = np.column_stack([np.cos(box[:, 3]), np.sin(box[:, 3]), np.zeros(len(box))])
        heading = np.einsum("rij,rj->ri", rotation, heading)
        moved = np.array(box, dtype=np.float64)
        moved[:, :3] = np.einsum("rij,rj->ri", rotation, box[:, :3]) + self.position[frame]
        moved[:, 3] = np.arctan2(heading[:, 1], heading[:, 0])
        return moved

    def to_sensor(self, box: Floats, frame: Ints) -> Floats:
        """Boxes ``[R, 7]`` of the world as seen in ``frame [R]``: the inverse of `to_world`."""
        rotation = self.rotation[frame]
        heading = np.stack([np.cos(box[:, 3]), np.sin(box[:, 3])], axis=-1)
        heading = np.linalg.solve(rotation[:, :2, :2], heading[..., None])[..., 0]  # its shadow is the heading there
        moved = np.array(box, dtype=np.float64)
        place = box[:, :3] - self.position[frame]
        moved[:, :3] = np.linalg.solve(rotation, place[..., None])[..., 0]  # odometry's are rotations up to rounding
        moved[:, 3] = np.arctan2(heading[:, 1], heading[:, 0])
        return moved


def integrated_poses(oxts: Oxts, imu_to_camera: Floats, period: float = FRAME_PERIOD) -> Poses:
    """Poses from the attitude and the integrated velocity of the GPS/IMU unit.

    Differences of latitude and longitude jitter by centimetres from frame to frame: the unit's samples come every
    10 ms and are not those of the images. The slow drift of the integral does not matter within a forecast.
    """
    mean = (oxts.velocity[1:] + oxts.velocity[:-1]) / 2
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(mean * period, axis=0)])
    return poses_from_imu(path, oxts.attitude, imu_to_camera)


def poses_from_imu(path: Floats, attitude: Floats, imu_to_camera: Floats) -> Poses:
    """Poses from positions ``[F, 3]`` (east, north, up) and attitudes ``[F, 3]`` of the GPS/IMU unit."""
    imu_from_sensor = np.linalg.inv(imu_to_camera)
    level_from_imu = _rotations(attitude)
    rotation = level_from_imu @ (imu_from_sensor[:3, :3] @ SENSOR_FROM_CAMERA.T)
    return _from_first(rotation, path + level_from_imu @ imu_from_sensor[:3, 3])


def odometry_poses(camera_poses: Floats, oxts: Oxts, imu_to_camera: Floats) -> Poses:
    """Poses from visual odometry ``[F, 3, 4]`` (camera to camera axes of frame 0), levelled by the first attitude."""
    level = poses_from_imu(np.zeros((1, 3)), oxts.attitude[:1], imu_to_camera).rotation[0]
    rotation = level @ SENSOR_FROM_CAMERA @ camera_poses[:, :, :3] @ SENSOR_FROM_CAMERA.T
    return _from_first(rotation, camera_poses[:, :, 3] @ (level @ SENSOR_FROM_CAMERA).T)


def _from_first(rotation: Floats, position: Floats) -> Poses:
    """Poses in the level frame of the first one."""
    yaw = np.arctan2(rotation[0, 1, 0], rotation[0, 0, 0])
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0.0], [-np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return Poses(rotation=turn @ rotation, position=(position - position[0]) @ turn.T)


def _rotations(attitude: Floats) -> Floats:
    """Rotations ``[F, 3, 3]`` Rz(yaw) Ry(pitch) Rx(roll) from forward, left, up to east, north, up."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(attitude).T, np.sin(attitude).T
    return np.stack(
        [
            np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=-1),
            np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=-1),
            np.stack([-sp, cp * sr, cp * cr], axis=-1),
        ],
        axis=-2,
    )
