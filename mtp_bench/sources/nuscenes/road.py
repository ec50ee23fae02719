"""The road around a scene, of the map expansion: read when something is drawn, never when a scene is loaded."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, Lane, Scene, starts_of
from ..base import DataRoot, section_of
from ..cache import Arrays, read_arrays, write_arrays
from . import folders
from .json_stream import Read, read_records, unwatched
from .layout import DATASET, EXPANSION, VERSIONS
from .map_file import PASSES, read_lanes
from .section import NuScenesSource
from .tables import known
from .work import working

FORMAT = 1  # of the lanes in the cache: a change of what is kept, or of how it is made, gets a new number
REACH = 100.0  # m from the way of the ego, within which the road is drawn


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """The lanes near the way of the ego, in the global frame; none where the map of its location is not there.

    A map is read once per machine, then kept as arrays. Raises DataError for a map or a table that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not (root / EXPANSION).is_dir():
        return ()
    path = root / EXPANSION / f"{location_of(root / section_of(card, NuScenesSource).version, scene.name)}.json"
    return near(_cached(path), scene.ego) if path.is_file() else ()


def location_of(version: Path, scene: str) -> str:
    """The place where a scene was recorded, such as "boston-seaport", by the tables in the folder ``version``."""
    logs = {str(record.get("token")): record for record in read_records(version / "log.json", unwatched)}
    path = version / "scene.json"
    for record in read_records(path, unwatched):
        if record.get("name") == scene:
            location = known(logs, record, path, "log").get("location")
            if isinstance(location, str) and re.fullmatch(r"[A-Za-z0-9_-]+", location):
                return location
            raise DataError(f"{version / 'log.json'}: location of {scene} is {location!r}, expected a name")
    raise DataError(f"{path} has no scene {scene!r}")


def near(arrays: Arrays, ego: Floats) -> tuple[Lane, ...]:
    """The lanes of a location that come within `REACH` of the ego's places [F, 4]."""
    point, start = arrays["point"], arrays["start"]
    place = point[:, 0]  # the middle lines
    seen = np.zeros(len(place), dtype=bool)
    for x, y in ego[:, :2]:
        seen |= np.hypot(place[:, 0] - x, place[:, 1] - y) <= REACH
    lanes = []
    for first, end, junction in zip(start[:-1], start[1:], arrays["junction"], strict=True):
        if seen[first:end].any():
            center, left, right = np.moveaxis(point[first:end], 1, 0)
            lanes.append(Lane(center, left, right, junction=bool(junction)))
    return tuple(lanes)


def _cached(path: Path) -> Arrays:
    """The lanes of a map file, of the cache where they are there; a cache that cannot be written is no obstacle."""
    size = 0 if folders.stamped_hash(path) else (PASSES + 1) * folders.file_size(path)
    with working(size, None, None) as work:
        read = work.on(path.name)
        digest = folders.joint_digest([("lanes", str(FORMAT)), (path.name, folders.file_hash(path, read))])
        kept = folders.cache_folder() / "maps" / f"{path.stem}-{digest}.npz"
        arrays = read_arrays(kept)
        if arrays is None:
            arrays = _arrays(path, read)
            with suppress(OSError):
                kept.parent.mkdir(parents=True, exist_ok=True)
                write_arrays(kept, arrays)
    return arrays


def _arrays(path: Path, read: Read) -> Arrays:
    lanes = read_lanes(path, read)
    points = [np.stack([lane.center, lane.left, lane.right], axis=1) for lane in lanes]
    return {
        "point": np.concatenate([np.zeros((0, 3, 2)), *points]),  # [P, 3, 2] m, global frame: middle, left, right
        "start": starts_of([len(own) for own in points]),  # [L + 1]
        "junction": np.array([lane.junction for lane in lanes], dtype=bool),  # [L]
    }
