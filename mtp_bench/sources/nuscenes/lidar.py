"""The lidar frame of a sample, in which UniAD writes its forecasts."""

from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from ...core import Floats
from ..cache import write_arrays
from .store import CachedFolder, TableStore
from .tables import (
    MountRecord,
    by_token,
    find,
    floats,
    read_lidar_records,
    read_poses,
    rotation_matrices,
    rotations,
)

LidarPose = tuple[
    Floats, Floats
]  # rotation [3, 3] and translation [3] to the global frame
_POSES = "all.lidar"


def lidar_pose(tables: TableStore, token: str) -> LidarPose:
    """Return the pose of LIDAR_TOP in the global frame at the sample ``token``.

    KeyError for another token. Raises DataError for a table that is wrong.
    """
    row_of_token, rotation, translation = _read_poses(tables)
    row = row_of_token[token]
    return rotation[row], translation[row]


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
    flat_height = points[..., :2] @ rotation[2, :2] + translation[2]
    lidar_height = (points[..., 2] - flat_height) / rotation[2, 2]
    lidar_points = np.concatenate([points[..., :2], lidar_height[..., None]], axis=-1)
    return np.asarray(lidar_points @ rotation.T + translation)


@lru_cache(maxsize=1)
def _read_poses(tables: TableStore) -> tuple[dict[str, int], Floats, Floats]:
    """Return row by token, rotations [N, 3, 3] and translations [N, 3]."""
    fill = partial(_fill_poses, tables)
    name = f"{tables.cache.path.name}-lidar"
    arrays = CachedFolder.of(name, tables.cache.sources, fill).read(_POSES)
    return tables.row_of_token, arrays["rotation"], arrays["translation"]


def _fill_poses(tables: TableStore, folder: Path) -> None:
    paths = tables.cache.sources
    records = read_lidar_records(paths, tables.row_of_token)
    poses = [record.ego_pose_token for record in records]
    place, rotation = read_poses(paths["ego_pose"], paths["sample_data"], poses)
    all_mounts = by_token(paths["calibrated_sensor"], MountRecord)
    mounts = [
        find(all_mounts, record, "calibrated_sensor_token", paths["sample_data"])
        for record in records
    ]
    mount_rotation = rotations(mounts, paths["calibrated_sensor"])
    mount_place = floats([mount.translation for mount in mounts], 3)
    to_world = rotation_matrices(rotation)
    arrays = {
        "rotation": to_world @ rotation_matrices(mount_rotation),
        "translation": np.einsum("nij,nj->ni", to_world, mount_place) + place,
    }
    write_arrays(folder / f"{_POSES}.npz", arrays)
