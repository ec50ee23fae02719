"""Images of the cameras of nuScenes at the keyframes of a scene: their files, and how they show the world.

They are kept per scene, since their tables have millions of records, and read when an event is drawn.
"""

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
    """The images of a scene whose files are there; DataError names the table and token that is wrong."""
    root = DATASET.find(data, VERSIONS)
    if not any(root.glob(CAMERAS)):
        return ()
    tables = open_tables(root, section_of(card, NuScenesSource).version)
    cache = CachedFolder.of(
        f"{tables.cache.path.name}-cameras",
        tables.cache.sources,
        partial(_fill, tables),
    )
    arrays = cache.read(scene.name)
    rows = zip(
        *(arrays[name].tolist() for name in ("frame", "camera", "path", "size")),
        strict=True,
    )
    return tuple(
        CameraImage(frame, camera, root / file, tuple(size), arrays["projection"][row])
        for row, (frame, camera, file, size) in enumerate(rows)
        if (root / file).is_file()
    )


def _fill(tables: TableStore, folder: Path) -> None:
    path = tables.cache.sources["sample_data"]
    cameras = _read_cameras(tables)
    row_of = tables.row_of_token
    records = read_records(path, ImageRecord)
    images = [
        each
        for each in records
        if each.is_key_frame and each.calibrated_sensor_token in cameras
    ]
    for image in images:
        parts = PurePosixPath(image.filename).parts
        if parts[:1] != ("samples",) or ".." in parts:
            got = f"filename is {image.filename!r}"
            raise DataError(
                f"{path}, record {image.token!r}: {got}, expected a file below samples/"
            )
    sample = np.array(
        [find(row_of, image, "sample_token", path) for image in images], dtype=np.int64
    )
    mounts = [cameras[image.calibrated_sensor_token] for image in images]
    sizes = [(max(1, image.width), max(1, image.height)) for image in images]
    arrays = {
        "frame": sample,
        "camera": np.array([channel for channel, _ in mounts], dtype=np.str_),
        "path": np.array([image.filename for image in images], dtype=np.str_),
        "size": np.array(sizes, dtype=np.int64).reshape(-1, 2),
        "projection": _projections(tables, images, [mount for _, mount in mounts]),
    }
    order = np.lexsort((arrays["camera"], sample))
    for name in tables.scenes:
        own = tables.samples(name)
        rows = order[slice(*np.searchsorted(sample[order], [own.start, own.stop]))]
        kept = {key: values[rows] for key, values in arrays.items()}
        write_arrays(
            folder / f"{name}.npz", {**kept, "frame": kept["frame"] - own.start}
        )


def _read_cameras(tables: TableStore) -> dict[str, tuple[str, CameraRecord]]:
    """Channel and mount of each camera by token of the calibrated sensor."""
    path = tables.cache.sources["calibrated_sensor"]
    sensors = by_token(tables.cache.sources["sensor"], SensorRecord)
    mounts = by_token(path, CameraRecord)
    channels = {
        token: find(sensors, mount, "sensor_token", path).channel
        for token, mount in mounts.items()
    }
    cameras = {
        token: (channels[token], mount)
        for token, mount in mounts.items()
        if channels[token].startswith("CAM_")
    }
    for _, mount in cameras.values():
        if len(mount.camera_intrinsic) != 3:
            raise DataError(
                f"{path}, record {mount.token!r}: camera_intrinsic needs 3 rows of 3 numbers"
            )
    rotations([mount for _, mount in cameras.values()], path)
    return cameras


def _projections(
    tables: TableStore, images: list[ImageRecord], mounts: list[CameraRecord]
) -> Floats:
    """From the global frame to the pixels of each image [n, 3, 4]."""
    sources = tables.cache.sources
    poses = [image.ego_pose_token for image in images]
    place, turn = read_poses(sources["ego_pose"], sources["sample_data"], poses)
    to_ego = _matrices(turn).swapaxes(1, 2)
    to_mount = _matrices(floats([mount.rotation for mount in mounts], 4)).swapaxes(1, 2)
    intrinsic = floats([mount.camera_intrinsic for mount in mounts], 9).reshape(
        -1, 3, 3
    )
    shift = np.einsum("nij,nj->ni", to_ego, place) + floats(
        [mount.translation for mount in mounts], 3
    )
    return np.asarray(
        intrinsic @ to_mount @ np.concatenate([to_ego, -shift[..., None]], axis=2)
    )


def _matrices(rotation: Floats) -> Floats:
    """Rotation matrices [n, 3, 3] of quaternions [n, 4] w x y z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(rotation[:, [1, 2, 3, 0]]).as_matrix())
