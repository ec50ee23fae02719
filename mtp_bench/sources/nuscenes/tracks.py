"""Tracks in the official submission form of the nuScenes tracking task.

One JSON file, boxes in the global frame.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import DataRoot, ReadTracks, TrackForm, class_ids
from ..stored_tracks import FEWER, with_stored
from ..tables import refuse, repeated
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
    """Return the scene with its tracks.

    Other classes are left out. Raises DataError for a sample that the file does not
    have, and for two boxes of one track in a sample.
    """
    samples = tables.samples(scene.name)
    missing_samples = np.setdiff1d(samples, boxes.covered)
    if len(missing_samples):
        token = tables.tokens.item(missing_samples[0]).decode()
        message = (
            f"{path}: no entry for sample {token!r} of {scene.name}, expected one for "
            f"each of its {scene.frames} samples, empty where nothing is tracked"
        )
        if len(missing_samples) == scene.frames:
            message += f"; {FEWER}"
        raise DataError(message)
    box_rows = np.arange(len(boxes.sample))[tables.rows_of(scene.name, boxes.sample)]
    class_id = class_ids(CLASSES, classes)[boxes.class_id[box_rows]]
    box_rows = box_rows[class_id >= 0]
    class_id = class_id[class_id >= 0]
    frame = boxes.sample[box_rows] - samples.start
    identity = boxes.identity[box_rows]

    def message_of(index: int) -> str:
        token = tables.tokens.item(boxes.sample[box_rows[index]]).decode()
        problem = f"a second box of tracking_id {str(identity[index])!r}, expected one"
        return f"{path}, sample {token!r}: {problem}"

    refuse(repeated(frame, identity, class_id), message_of)
    return with_stored(
        scene,
        frame,
        identity,
        class_id,
        boxes.box[box_rows],
        boxes.score[box_rows],
        boxes.velocity[box_rows],
    )


def submission_box(
    token: str, box: Floats, velocity: Floats, name: str, identity: str, score: float
) -> dict[str, Any]:
    """Return one box [7] of the scene's frame of reference, as the form has it.

    ``velocity`` [2] m/s.
    """
    x, y, z, yaw, length, width, height = np.asarray(box, dtype=np.float64).tolist()
    return {
        "sample_token": token,
        "translation": [x, y, z],
        "size": [width, length, height],
        "rotation": [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))],
        "velocity": np.asarray(velocity, dtype=np.float64).tolist(),
        "tracking_id": identity,
        "tracking_name": name,
        "tracking_score": float(score),
    }


# boxes of one file, which is read once per process, not per scene
_last_read: dict[tuple[Path, int, int, Path], SubmittedBoxes] = {}


def _read_boxes(path: Path, tables: TableStore) -> SubmittedBoxes:
    state = path.stat()
    key = (path, state.st_size, state.st_mtime_ns, tables.cache.path)
    if key not in _last_read:
        boxes = read_submission(path, tables.row_of_token, TrackedBox)
        if not len(boxes.covered):
            version = tables.version
            message = no_match(path, boxes.samples, boxes.example, version, "tracks")
            raise DataError(message)
        _last_read.clear()
        _last_read[key] = boxes
    return _last_read[key]


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    tables = NuScenes(card, data).tables
    boxes = _read_boxes(path, tables)
    classes = card.task.classes
    return lambda scene: scene_tracks(boxes, tables, path, scene, classes)


FORM = TrackForm(
    "a .json file in the submission form of the nuScenes tracking task",
    lambda path: path.is_file() and path.suffix == ".json",
    _open,
)
