"""Images of the cameras of nuScenes at the keyframes of a scene: their files, and how they show the world.

The tables of sensor data and of ego poses have millions of records, so what is needed of them is kept per scene. It is
read when an event is drawn and there are images, never when a scene is loaded.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, Scene
from ..base import DataRoot, section_of
from ..cache import Arrays, read_arrays, write_arrays
from ..images import CameraImage
from . import folders
from .fields import add_numbers, check, extended, floats, ints, named, text, whole
from .json_stream import Read, Record, brief, read_records, unwatched
from .layout import CAMERAS, DATASET, VERSIONS
from .section import NuScenesSource
from .store import SAMPLES, TableStore, find_tables
from .tables import by_token, known, read_poses
from .work import no_work, working

FORMAT = 1  # of the arrays in the cache: a change gets a new number


@dataclass(frozen=True, eq=False)
class _Mounts:
    """How the cameras are mounted and what they show, by token of the calibrated sensor."""

    row: dict[str, int]
    channel: list[str]
    translation: Floats  # [C, 3] m, in the frame of the ego
    rotation: Floats  # [C, 4] quaternions w x y z
    intrinsic: Floats  # [C, 3, 3]


@dataclass(frozen=True, eq=False)
class _Rows:
    """Images of keyframes, in the order of the table."""

    sample: array[int] = field(default_factory=lambda: array("q"))  # row of the keyframe
    mount: array[int] = field(default_factory=lambda: array("q"))
    size: array[int] = field(default_factory=lambda: array("q"))  # width, height
    pose: list[str] = field(default_factory=list)  # tokens
    file: list[str] = field(default_factory=list)


def scene_images(card: Card, data: DataRoot, scene: Scene) -> tuple[CameraImage, ...]:
    """The images of a scene whose files are there; DataError names the table and token that is wrong."""
    root = DATASET.find(data, VERSIONS)
    if not any(root.glob(CAMERAS)):
        return ()
    store = find_tables(root, section_of(card, NuScenesSource).version).open(no_work())
    arrays = _cached(store, scene.name)
    rows = zip(*(arrays[name].tolist() for name in ("frame", "camera", "path", "size")), strict=True)
    return tuple(
        CameraImage(frame, camera, root / file, tuple(size), arrays["projection"][at])
        for at, (frame, camera, file, size) in enumerate(rows)
        if (root / file).is_file()
    )


def _cached(store: TableStore, name: str) -> Arrays:
    """The images of a scene, of the cache that is made of all scenes where it is not there."""
    folder = store.folder.with_name(f"{store.folder.name}-cameras{FORMAT}")
    paths = [store.tables.paths[table] for table in ("sample_data", "ego_pose")]

    def make() -> None:
        with working(sum(folders.file_size(path) for path in paths), None, None) as work:
            _build(store, folder, work.on(store.tables.version))

    return folders.made(folder / f"{name}.npz", read_arrays, make)


def _build(store: TableStore, folder: Path, read: Read) -> None:
    samples = store.arrays(SAMPLES)
    mounts = _read_mounts(store)
    row_of = {str(token): at for at, token in enumerate(samples["token"])}
    rows = _read_images(store.tables.paths["sample_data"], mounts, row_of, read)
    sample = ints(rows.sample)
    arrays = {
        "frame": sample,
        "camera": np.array([mounts.channel[at] for at in rows.mount], dtype=np.str_),
        "path": np.array(rows.file, dtype=np.str_),
        "size": ints(rows.size).reshape(-1, 2),
        "projection": _projections(store, mounts, rows, read),
    }

    def fill(part: Path) -> None:
        for name, start, end in zip(store.index["scenes"], samples["start"], samples["start"][1:], strict=False):
            own = np.flatnonzero((sample >= start) & (sample < end))
            own = own[np.lexsort((arrays["camera"][own], sample[own]))]
            kept = {key: values[own] for key, values in arrays.items()}
            write_arrays(part / f"{name}.npz", {**kept, "frame": kept["frame"] - start})

    folders.build(folder, fill)


def _read_mounts(store: TableStore) -> _Mounts:
    sensors, path = store.tables.paths["sensor"], store.tables.paths["calibrated_sensor"]
    channel_of = {token: text(sensors, record, "channel") for token, record in by_token(sensors, unwatched)}
    tokens, channels = list[str](), list[str]()
    translation, rotation, intrinsic = array("d"), array("d"), array("d")
    for token, record in by_token(path, unwatched):
        channel = known(channel_of, record, path, "sensor")
        if not channel.startswith("CAM_"):
            continue
        tokens.append(token)
        channels.append(channel)
        add_numbers(path, record, "translation", 3, translation)
        add_numbers(path, record, "rotation", 4, rotation)
        _add_intrinsic(path, record, intrinsic)
    values = {"translation": floats(translation, 3), "rotation": floats(rotation, 4)}
    check(path, tokens, {**values, "camera_intrinsic": floats(intrinsic, 9)})
    return _Mounts(
        {token: at for at, token in enumerate(tokens)},
        channels,
        **values,
        intrinsic=floats(intrinsic, 9).reshape(-1, 3, 3),
    )


def _add_intrinsic(path: Path, record: Record, to: array[float]) -> None:
    rows = record.get("camera_intrinsic")
    if not isinstance(rows, list) or len(rows) != 3 or not all(extended(to, row, 3) for row in rows):
        raise DataError(f"{path}, {named(record)}: camera_intrinsic is {brief(rows)}, expected 3 rows of 3 numbers")


def _read_images(path: Path, mounts: _Mounts, row_of: dict[str, int], read: Read) -> _Rows:
    rows = _Rows()
    for record in read_records(path, read):
        mount = mounts.row.get(str(record.get("calibrated_sensor_token")))
        if mount is None or record.get("is_key_frame") is not True:
            continue
        rows.sample.append(known(row_of, record, path, "sample"))
        rows.mount.append(mount)
        rows.size.extend([max(1, whole(path, record, "width")), max(1, whole(path, record, "height"))])
        rows.pose.append(text(path, record, "ego_pose_token"))
        file = text(path, record, "filename")
        if PurePosixPath(file).parts[:1] != ("samples",) or ".." in PurePosixPath(file).parts:
            raise DataError(f"{path}, {named(record)}: filename is {brief(file)}, expected a file below samples/")
        rows.file.append(file)
    return rows


def _projections(store: TableStore, mounts: _Mounts, rows: _Rows, read: Read) -> Floats:
    """From the global frame to the pixels of each image [n, 3, 4]."""
    paths = store.tables.paths
    place, turn = read_poses(paths["ego_pose"], paths["sample_data"], rows.pose, read)
    mount = ints(rows.mount)
    to_ego = _matrices(turn).swapaxes(1, 2)
    to_camera = mounts.intrinsic[mount] @ _matrices(mounts.rotation[mount]).swapaxes(1, 2)
    shift = np.einsum("nij,nj->ni", to_ego, place) + mounts.translation[mount]
    return np.asarray(to_camera @ np.concatenate([to_ego, -shift[..., None]], axis=2))


def _matrices(rotation: Floats) -> Floats:
    """Rotation matrices [n, 3, 3] of quaternions [n, 4] w x y z."""
    w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
