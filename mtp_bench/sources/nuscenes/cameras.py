"""Images of the cameras of nuScenes at the keyframes of a scene.

They are kept per scene, since their tables have millions of records, and read when an
event is drawn.
"""

from collections.abc import Collection
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import CameraImage, DataRoot, section_of
from ..cache import write_arrays
from .layout import CAMERAS, DATASET, VERSIONS, NuScenesSource
from .store import CachedFolder, TableStore, open_tables
from .tables import (
    CameraRecord,
    ImageRecord,
    SensorRecord,
    by_token,
    find,
    floats,
    read_poses,
    read_records,
    rotations,
)


def scene_images(card: Card, data: DataRoot, scene: Scene) -> tuple[CameraImage, ...]:
    """Return the images of a scene whose files are there.

    DataError names the table and token that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not any(root.glob(CAMERAS)):
        return ()
    tables = open_tables(root, section_of(card, NuScenesSource).version)
    name = f"{tables.cache.path.name}-cameras"
    cache = CachedFolder.of(name, tables.cache.sources, partial(_fill, tables))
    arrays = cache.read(scene.name)
    images: list[CameraImage] = []
    for row, file in enumerate(arrays["path"].tolist()):
        if (root / file).is_file():
            width, height = arrays["size"][row].tolist()
            image = CameraImage(
                frame=arrays["frame"].item(row),
                camera=arrays["camera"].item(row),
                path=root / file,
                size=(width, height),
                projection=arrays["projection"][row],
            )
            images.append(image)
    return tuple(images)


def _fill(tables: TableStore, folder: Path) -> None:
    path = tables.cache.sources["sample_data"]
    cameras = _read_cameras(tables)
    images = _read_images(path, cameras)
    row_of_token = tables.row_of_token
    samples = [find(row_of_token, image, "sample_token", path) for image in images]
    sample = np.array(samples, dtype=np.int64)
    mounts = [cameras[image.calibrated_sensor_token] for image in images]
    channels = [channel for channel, _ in mounts]
    image_size = floats([(image.width, image.height) for image in images], 2)
    arrays = {
        "frame": sample,
        "camera": np.array(channels, dtype=np.str_),
        "path": np.array([image.filename for image in images], dtype=np.str_),
        "size": np.maximum(image_size, 1).astype(np.int64),
        "projection": _projections(tables, images, [mount for _, mount in mounts]),
    }
    image_order = np.lexsort((arrays["camera"], sample))
    for name in tables.scenes:
        image_rows = image_order[tables.rows_of(name, sample[image_order])]
        scene_arrays = {key: values[image_rows] for key, values in arrays.items()}
        scene_arrays["frame"] = scene_arrays["frame"] - tables.samples(name).start
        write_arrays(folder / f"{name}.npz", scene_arrays)


def _read_images(path: Path, cameras: Collection[str]) -> list[ImageRecord]:
    """Read the records of the images of ``cameras`` (tokens) at keyframes."""
    images: list[ImageRecord] = []
    for record in read_records(path, ImageRecord):
        if not record.is_key_frame or record.calibrated_sensor_token not in cameras:
            continue
        parts = PurePosixPath(record.filename).parts
        if parts[:1] != ("samples",) or ".." in parts:
            raise DataError(
                f"{path}, record {record.token!r}: filename is {record.filename!r}, "
                "expected a file below samples/"
            )
        images.append(record)
    return images


def _read_cameras(tables: TableStore) -> dict[str, tuple[str, CameraRecord]]:
    """Return channel and mount of each camera by token of the calibrated sensor."""
    path = tables.cache.sources["calibrated_sensor"]
    sensors = by_token(tables.cache.sources["sensor"], SensorRecord)
    cameras: dict[str, tuple[str, CameraRecord]] = {}
    for token, mount in by_token(path, CameraRecord).items():
        channel = find(sensors, mount, "sensor_token", path).channel
        if not channel.startswith("CAM_"):
            continue
        if len(mount.camera_intrinsic) != 3:
            raise DataError(
                f"{path}, record {token!r}: camera_intrinsic needs 3 rows of 3 numbers"
            )
        cameras[token] = channel, mount
    rotations([mount for _, mount in cameras.values()], path)
    return cameras


def _projections(
    tables: TableStore, images: list[ImageRecord], mounts: list[CameraRecord]
) -> Floats:
    """Return projections [n, 3, 4] from the global frame to pixels of each image."""
    sources = tables.cache.sources
    poses = [image.ego_pose_token for image in images]
    place, rotation = read_poses(sources["ego_pose"], sources["sample_data"], poses)
    mount_rotation = floats([mount.rotation for mount in mounts], 4)
    mount_place = floats([mount.translation for mount in mounts], 3)
    intrinsic = floats([mount.camera_intrinsic for mount in mounts], 9)
    to_ego = _matrices(rotation).swapaxes(1, 2)
    to_mount = _matrices(mount_rotation).swapaxes(1, 2)
    shift = np.einsum("nij,nj->ni", to_ego, place) + mount_place
    pose = np.concatenate([to_ego, -shift[..., None]], axis=2)
    return np.asarray(intrinsic.reshape(-1, 3, 3) @ to_mount @ pose)


def _matrices(rotation: Floats) -> Floats:
    """Return rotation matrices [n, 3, 3] of quaternions [n, 4] w x y z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(rotation[:, [1, 2, 3, 0]]).as_matrix())
