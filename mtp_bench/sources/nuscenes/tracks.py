"""Tracks in the official submission form of the nuScenes tracking task: one JSON file, boxes in the global frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Floats, Scene, StoredTracks
from ..base import DataRoot, ReadTracks, TrackForm, class_ids
from ..text import refuse, repeated
from ..tracks.building import FEWER, stored_tracks
from .classes import CLASSES
from .detection_file import TRACKING, DetectedBoxes, no_match, read_detections
from .json_stream import unwatched
from .source import NuScenes
from .store import SAMPLES, TableStore


@dataclass(frozen=True, eq=False)
class _File:
    """The boxes of a file, and the samples of the tables."""

    boxes: DetectedBoxes
    samples: Sequence[str]  # tokens of all samples


def scene_tracks(file: _File, path: Path, scene: Scene, first: int, classes: Sequence[str]) -> StoredTracks:
    """The tracks of a scene whose samples are rows ``first``... of the tables; other classes are left out.

    Raises DataError for a sample that the file does not have, and for two boxes of one track in a sample.
    """
    boxes, end = file.boxes, first + scene.frames
    lost = np.setdiff1d(np.arange(first, end), boxes.covered)
    if len(lost):
        fewer = f"; {FEWER}" if len(lost) == scene.frames else ""  # the file has nothing of this scene
        raise DataError(
            f"{path}: no entry for sample {file.samples[lost[0]]!r} of {scene.name}, expected one for each of its "
            f"{scene.frames} samples, empty where nothing is tracked{fewer}"
        )
    row = np.arange(*np.searchsorted(boxes.sample, [first, end]))
    class_id = class_ids(CLASSES, classes)[boxes.class_id[row]]
    row, class_id = row[class_id >= 0], class_id[class_id >= 0]
    frame = boxes.sample[row] - first
    found = stored_tracks(
        scene.frames, frame, boxes.identity[row], class_id, boxes.box[row], boxes.score[row], boxes.velocity[row]
    )

    def what(at: int) -> str:
        token, name = file.samples[first + int(frame[at])], str(boxes.identity[row[at]])
        return f"{path}, sample {token!r}: a second box of tracking_id {name!r}, expected one"

    refuse(repeated(found.frame_of_rows, found.object_id), what)
    return found


def submission_box(token: str, box: Floats, velocity: Floats, name: str, identity: str, score: float) -> dict[str, Any]:
    """One box [7] of the scene's frame of reference with its velocity [2], as the form has it."""
    x, y, z, yaw, length, width, height = (float(value) for value in box)
    return {
        "sample_token": token,
        "translation": [x, y, z],
        "size": [width, length, height],
        "rotation": [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))],
        "velocity": [float(value) for value in velocity],
        "tracking_id": identity,
        "tracking_name": name,
        "tracking_score": float(score),
    }


_kept: dict[tuple[Path, int, int, Path], _File] = {}  # the last file: it is read once per process, not per scene


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    tables = NuScenes(card, data).tables
    file = _read(path, tables)
    start = dict(zip(tables.index["scenes"], tables.arrays(SAMPLES)["start"].tolist(), strict=False))

    def read(scene: Scene) -> StoredTracks:
        return scene_tracks(file, path, scene, start[scene.name], card.task.classes)

    return read


def _read(path: Path, tables: TableStore) -> _File:
    state = path.stat()
    key = path, state.st_size, state.st_mtime_ns, tables.folder
    if key not in _kept:
        tokens = [str(token) for token in tables.arrays(SAMPLES)["token"]]
        boxes = read_detections(path, {token: at for at, token in enumerate(tokens)}, unwatched, TRACKING)
        if not len(boxes.covered):
            raise DataError(no_match(path, boxes.samples, boxes.example, tables.tables.version, "tracks"))
        _kept.clear()
        _kept[key] = _File(boxes, tokens)
    return _kept[key]


def _fits(path: Path) -> bool:
    return path.is_file() and path.suffix == ".json"


FORM = TrackForm("a .json file in the submission form of the nuScenes tracking task", _fits, _open)
