"""nuScenes logs with stored detections or tracks, from the official tables.

Tracks come in the submission form of the tracking task: one JSON file, boxes in the
global frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cards import Card
from ...core import DataError, Floats, MissingDataError, Scene, Truth
from ..base import (
    DataRoot,
    ReadTracks,
    TrackForm,
    Work,
    class_ids,
    names_by_number,
    no_detections,
    require_classes,
    require_rate,
    section_of,
    stored_label,
)
from ..cache import Arrays
from ..motion import looking_back, unknown_velocity
from ..stored_tracks import FEWER, with_stored
from ..tables import refuse, repeated
from .layout import (
    CLASSES,
    DATASET,
    PREDICTION,
    VERSIONS,
    NuScenesSource,
    detection_paths,
    require_maps,
    scenes_by_split,
)
from .store import TableStore, open_tables
from .submission import (
    SubmittedBoxes,
    TrackedBox,
    no_match,
    open_detections,
    read_submission,
    scene_detections,
)
from .tables import SECOND_US

RATE_HZ = 2.0  # of the keyframes, nominal


class NuScenes:
    """Scenes of one split of nuScenes, in the global frame of their map.

    Frames are the keyframes at their real times, from 0. The ego is the LIDAR_TOP pose
    of each. With ``truth = "targets"`` the truth has only the objects that the
    prediction challenge names in a scene, and only scenes with one are listed.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, NuScenesSource)
        require_classes(card, DATASET.name, CLASSES)
        require_rate(card, DATASET.name, RATE_HZ)
        self.root = DATASET.find(data, VERSIONS)
        require_maps(self.root, card)
        paths = detection_paths(self.root, card)
        self.tables = open_tables(self.root, self.section.version)
        self.names = self._find_scenes()
        self.detections = open_detections(paths, self.tables, self.names)

    def _find_scenes(self) -> tuple[str, ...]:
        """Return the scenes of the split.

        Raises DataError without any.
        """
        section = self.section
        scenes = list(self.tables.scenes)
        condition = ""
        if section.truth == "targets":
            condition = " with prediction targets"
            if self.tables.targets is not None:
                rows = np.flatnonzero(self.tables.targets)
                scenes = [scenes[row] for row in rows]
        splits = scenes_by_split(scenes)
        if section.split not in splits:
            counts = [f"{split} ({len(names)})" for split, names in splits.items()]
            raise DataError(
                f"{self.root / section.version} has no scene of split "
                f"{section.split!r}{condition}; splits with scenes: "
                f"{', '.join(counts) or 'none'}; choose one with --split or split="
            )
        return splits[section.split]

    def load(self, name: str) -> Scene:
        """Read one scene from the cache."""
        arrays = self.tables.cache.read(name)
        classes = self.card.task.classes
        time = (arrays["time"] - arrays["time"][0]) / SECOND_US
        detections = no_detections(len(time))
        detector = ""
        if self.detections:
            samples = self.tables.samples(name)
            detections = scene_detections(self.detections, samples, name, classes)
            detector = self.section.detector
        listed = self.section.truth == "targets"
        truth = scene_truth(arrays, time, classes, listed)
        instances = arrays["instance"][truth.object_id]
        return Scene(
            name=name,
            time=time,
            ego=arrays["ego"],
            truth=truth,
            detections=detections,
            detector=stored_label(detector),
            object_names=names_by_number(truth.object_id, instances),
            truth_complete=not listed,
            listed_targets=listed,
        )

    def listed_truth(self, name: str) -> tuple[Truth, NDArray[np.str_]]:
        """Return every box of a scene, and its class [R] of nuScenes.

        Eligible are the targets of the prediction challenge, whatever the card has.
        Raises MissingDataError without their list.
        """
        if self.tables.targets is None:
            raise MissingDataError(
                f"no file {self.root / PREDICTION}: official numbers need the targets "
                "of the prediction challenge; unpack the map expansion into maps/"
            )
        arrays = self.tables.cache.read(name)
        truth = scene_truth(arrays, arrays["time"] / SECOND_US, CLASSES, listed=False)
        truth = replace(truth, eligible=arrays["listed"])
        return truth, np.array(CLASSES)[truth.class_id]


def prepare_nuscenes(
    card: Card, data: DataRoot, scenes: int | None, workers: int
) -> Work:
    """Make the compact copy of the tables and detections of ``card``, if missing.

    It is one piece of work, whatever ``scenes`` and ``workers`` are. Raises DataError
    for everything that stops the card's scenes from being read.
    """

    def open_once() -> Iterator[str]:
        yield NuScenes(card, data).section.version

    return 1, open_once()


def scene_truth(
    arrays: Arrays, time: Floats, classes: Sequence[str], listed: bool
) -> Truth:
    """Return the truth of a scene from its cached arrays.

    ``listed``: only of prediction targets, eligible in the frames that list them.
    """
    class_id = class_ids(CLASSES, classes)[arrays["class_id"]]
    object_id = arrays["object_id"]
    is_used = class_id >= 0
    neutral = arrays["neutral"]
    eligible = np.ones(len(class_id), dtype=bool)
    if listed:
        eligible = arrays["listed"]
        is_target = np.isin(object_id, object_id[eligible])
        is_used &= is_target
        neutral = neutral & ~is_target  # a target counts, whatever its category
    truth = Truth(
        start=arrays["start"],
        box=arrays["box"],
        velocity=unknown_velocity(len(class_id)),
        class_id=class_id,
        object_id=object_id,
        eligible=eligible,
        neutral=neutral,
    )
    return looking_back(truth.select(is_used), time, 1 / RATE_HZ)


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
    """Return one box of a submission to the tracking task.

    ``token`` of the sample; ``box`` [7] in the scene's frame of reference; ``velocity``
    [2] m/s; ``name`` of the class.
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
    name="a .json file in the submission form of the nuScenes tracking task",
    fits=lambda path: path.is_file() and path.suffix == ".json",
    open=_open,
)
