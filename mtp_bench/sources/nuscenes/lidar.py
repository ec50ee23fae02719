"""The lidar frame of a sample, in which UniAD writes its forecasts."""

import numpy as np

from ...core import Floats
from .store import TableStore

# rotation [3, 3] and translation [3], m, from the lidar frame to the global one
LidarPose = tuple[Floats, Floats]


def lidar_pose(tables: TableStore, token: str) -> LidarPose:
    """Return the pose of LIDAR_TOP in the global frame at the sample ``token``.

    KeyError for another token.
    """
    to_frame = tables.to_lidar[tables.row_of_token[token]]
    rotation = to_frame[:, :3].T
    return rotation, -rotation @ to_frame[:, 3]


def to_lidar(points: Floats, pose: LidarPose) -> Floats:
    """Return ``points`` [..., 3] of the global frame in the frame of the lidar."""
    rotation, translation = pose
    return np.asarray((points - translation) @ rotation)


def to_global(points: Floats, pose: LidarPose) -> Floats:
    """Return ``points`` [..., 3] of UniAD's form in the global frame.

    They are x and y in the frame of the lidar, and the height of their box in the
    **global** frame, as the form keeps no height of a forecast.
    """
    rotation, translation = pose
    lidar_points = points.copy()
    # global height = translation + rotation of (x, y, height in the lidar frame)
    lidar_points[..., 2] -= translation[2] + points[..., :2] @ rotation[2, :2]
    lidar_points[..., 2] /= rotation[2, 2]
    return np.asarray(lidar_points @ rotation.T + translation)
