"""The lidar frame of a sample, in which UniAD writes its forecasts."""

from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from ...core import Floats
from ..cache import Arrays, write_arrays
from .store import CachedFolder, TableStore
from .tables import MountRecord, by_token, read_lidar_records, rotations, to_sensors

# rotation [3, 3] and translation [3], m, from the lidar frame to the global one
LidarPose = tuple[Floats, Floats]


def lidar_pose(tables: TableStore, token: str) -> LidarPose:
    """Return the pose of LIDAR_TOP in the global frame at the sample ``token``.

    KeyError for another token. Raises DataError for a table that is wrong.
    """
    to_frame = _read_transforms(tables)[token]
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


@lru_cache(maxsize=1)
def _read_transforms(tables: TableStore) -> Arrays:
    """Return the transform [3, 4] from the global frame to the lidar, by token."""
    name = f"{tables.cache.path.name}-to-lidar"
    fill = partial(_fill, tables)
    transforms = CachedFolder.of(name, tables.cache.sources, fill).read(_FILE)
    return dict(zip(tables.row_of_token, transforms["to_lidar"], strict=True))


_FILE = "all.to_lidar"


def _fill(tables: TableStore, folder: Path) -> None:
    paths = tables.cache.sources
    records = read_lidar_records(paths, tables.row_of_token)
    all_mounts = by_token(paths["calibrated_sensor"], MountRecord)
    # channels were looked up with these tokens
    mounts = [all_mounts[record.calibrated_sensor_token] for record in records]
    rotations(mounts, paths["calibrated_sensor"])
    write_arrays(
        folder / f"{_FILE}.npz", {"to_lidar": to_sensors(paths, records, mounts)}
    )
