"""The road around a scene, of the map expansion: read when something is drawn, never when a scene is loaded."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, Lane, Scene, starts_of
from ..base import DataRoot, section_of
from ..cache import Arrays, write_arrays
from .decoding import Record, by_token, find, read_records
from .folders import CachedFolder
from .layout import DATASET, EXPANSION, VERSIONS
from .map_file import read_lanes
from .section import NuScenesSource
from .source import show_reading
from .store import Note

REACH = 100.0  # m from the way of the ego, within which the road is drawn


class _Log(Record):
    location: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$")]


class _Scene(Record):
    name: str
    log_token: str


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """The lanes near the way of the ego, in the global frame; none if there is no map of its location.

    A map is read once per machine, then kept as arrays. Raises DataError for a map or a table that is wrong.
    """
    root = DATASET.find(data, VERSIONS)
    if not (root / EXPANSION).is_dir():
        return ()
    path = root / EXPANSION / f"{location_of(root / section_of(card, NuScenesSource).version, scene.name)}.json"
    if not path.is_file():
        return ()
    with show_reading() as note:
        arrays = CachedFolder.of(f"map-{path.stem}", {path.name: path}, partial(_fill, path, note)).read("lanes")
    return near(arrays, scene.ego)


def location_of(version: Path, scene: str) -> str:
    """The place where a scene was recorded, such as "boston-seaport", by the tables in the folder ``version``."""
    logs, path = by_token(version / "log.json", _Log), version / "scene.json"
    for record in read_records(path, _Scene):
        if record.name == scene:
            return find(logs, record, "log_token", path).location
    raise DataError(f"{path} has no scene {scene!r}")


def near(arrays: Arrays, ego: Floats) -> tuple[Lane, ...]:
    """The lanes of a location that come within `REACH` of the ego's places [F, 4]."""
    point, start = arrays["point"], arrays["start"]
    center = point[:, 0]
    seen = np.zeros(len(center), dtype=bool)
    for x, y in ego[:, :2]:
        seen |= np.hypot(center[:, 0] - x, center[:, 1] - y) <= REACH
    return tuple(
        Lane(point[first:end, 0], point[first:end, 1], point[first:end, 2], junction=bool(junction))
        for first, end, junction in zip(start[:-1], start[1:], arrays["junction"], strict=True)
        if seen[first:end].any()
    )


def _fill(path: Path, note: Note, folder: Path) -> None:
    note(path.name)
    lanes = read_lanes(path)
    points = [np.stack([lane.center, lane.left, lane.right], axis=1) for lane in lanes]
    arrays = {
        "point": np.concatenate(points),  # [P, 3, 2] m, global frame: middle, left, right
        "start": starts_of([len(own) for own in points]),  # [L + 1]
        "junction": np.array([lane.junction for lane in lanes], dtype=bool),  # [L]
    }
    write_arrays(folder / "lanes.npz", arrays)
