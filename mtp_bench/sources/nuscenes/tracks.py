"""Tracks in the official submission form of the nuScenes tracking task: one JSON file, boxes in the global frame."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import DataRoot, ReadTracks, TrackForm, class_ids
from ..stored_tracks import FEWER, with_stored
from ..text import refuse, repeated
from .layout import CLASSES
from .source import NuScenes
from .store import TableStore
from .submission import SubmittedBoxes, TrackedBox, no_match, read_submission


def scene_tracks(
    boxes: SubmittedBoxes,
    tables: TableStore,
    path: Path,
    scene: Scene,
    classes: Sequence[str],
) -> Scene:
    """The scene with its tracks; other classes are left out.

    Raises DataError for a sample that the file does not have, and for two boxes of one track in a sample.
    """
    samples = tables.samples(scene.name)
    lost = np.setdiff1d(samples, boxes.covered)
    if len(lost):
        fewer = (
            f"; {FEWER}" if len(lost) == scene.frames else ""
        )  # the file has no sample of this scene
        raise DataError(
            f"{path}: no entry for sample {tables.tokens.item(lost[0]).decode()!r} of {scene.name}, expected one for "
            f"each of its {scene.frames} samples, empty where nothing is tracked{fewer}"
        )
    row = np.arange(*np.searchsorted(boxes.sample, [samples.start, samples.stop]))
    class_id = class_ids(CLASSES, classes)[boxes.class_id[row]]
    row, class_id = row[class_id >= 0], class_id[class_id >= 0]
    frame, identity = boxes.sample[row] - samples.start, boxes.identity[row]

    def what(index: int) -> str:
        token, name = (
            tables.tokens.item(boxes.sample[row[index]]).decode(),
            str(identity[index]),
        )
        return f"{path}, sample {token!r}: a second box of tracking_id {name!r}, expected one"

    refuse(repeated(frame, identity, class_id), what)
    return with_stored(
        scene,
        frame,
        identity,
        class_id,
        boxes.box[row],
        boxes.score[row],
        boxes.velocity[row],
    )


def submission_box(
    token: str, box: Floats, velocity: Floats, name: str, identity: str, score: float
) -> dict[str, Any]:
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


_last_read: dict[tuple[Path, int, int, Path], SubmittedBoxes] = {}  # one file


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    tables = NuScenes(card, data).tables
    return partial(
        scene_tracks, _read(path, tables), tables, path, classes=card.task.classes
    )


def _read(path: Path, tables: TableStore) -> SubmittedBoxes:
    """The boxes of a file, which is read once per process, not per scene."""
    state = path.stat()
    key = path, state.st_size, state.st_mtime_ns, tables.cache.path
    if key not in _last_read:
        boxes = read_submission(path, tables.row_of_token, TrackedBox)
        if not len(boxes.covered):
            raise DataError(
                no_match(path, boxes.samples, boxes.example, tables.version, "tracks")
            )
        _last_read.clear()
        _last_read[key] = boxes
    return _last_read[key]


FORM = TrackForm(
    "a .json file in the submission form of the nuScenes tracking task",
    lambda path: path.is_file() and path.suffix == ".json",
    _open,
)
