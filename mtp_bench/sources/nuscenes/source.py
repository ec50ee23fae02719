"""nuScenes logs with stored detections, from the official tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError, UnknownNameError
from ...types import Floats, Ragged, Scene, Truth, starts_of_sorted
from ..base import Preparation, class_ids, no_detections, require_classes, require_rate, section_of
from ..cache import Arrays
from ..motion import backward_velocity
from .classes import CLASSES
from .detections import DetectionStore, bytes_left, open_detections, require_covered, scene_detections
from .layout import DATASET, VERSIONS, detection_paths, require_prediction
from .section import NuScenesSource
from .splits import counted, splits_of
from .store import TableStore, find_tables
from .tables import SECOND
from .work import working

RATE = 2.0  # Hz of the keyframes, nominal


class NuScenes:
    """Scenes of one split of nuScenes, in the global frame of their map.

    Frames are the keyframes at their real times, from 0. The ego is the LIDAR_TOP pose of each. With ``truth =
    "targets"`` only the objects that the prediction challenge names in a scene are in its truth.
    """

    def __init__(
        self,
        card: Card,
        data: str | Path | None = None,
        started: Callable[[int], object] | None = None,
        progress: Callable[[str], object] | None = None,
    ) -> None:
        self.card = card
        self.section = section_of(card, NuScenesSource)
        require_classes(card, DATASET.name, CLASSES)
        require_rate(card, DATASET.name, RATE)
        self.root = DATASET.find(data, VERSIONS)
        tables = find_tables(self.root, self.section.version)
        require_prediction(self.root, card)
        paths = detection_paths(self.root, card)
        with working(tables.bytes_left + bytes_left(paths, tables.known_folder), started, progress) as work:
            self.tables: TableStore = tables.open(work)
            splits = available_splits(self.tables, self.section.truth == "targets")
            self.names = _names(card, self.root, splits)
            self.detections: tuple[DetectionStore, ...] = open_detections(paths, self.tables, work)
        if paths:
            _check_hash(card, self.detections)
            require_covered(self.detections, self.names, splits, self.section.split)

    def load(self, name: str) -> Scene:
        """Read one scene from the cache."""
        if name not in self.names:
            raise UnknownNameError("scene", name, self.names)
        arrays, classes = self.tables.arrays(name), self.card.task.classes
        time = (arrays["time"] - arrays["time"][0]) / SECOND
        detections, label = no_detections(len(time)), ""
        if self.detections:
            label = f"{self.section.detector}, stored detections"
            detections = scene_detections(self.detections, name, len(time), classes)
        listed = self.section.truth == "targets"
        return Scene(
            name=name,
            time=time,
            ego=arrays["ego"],
            truth=scene_truth(arrays, time, classes, listed),
            detections=detections,
            detector=label,
            truth_complete=not listed,
            listed_targets=listed,
        )


def prepare_nuscenes(card: Card, data: str | Path | None, how: Preparation) -> None:
    """Make the compact copy of the tables and detections of ``card`` where it is not there.

    Progress is told by hundredths of the bytes to read, with the name of the file. Raises DataError for everything that
    stops the card's scenes from being read.
    """
    NuScenes(card, data, how.started, how.progress)


def available_splits(tables: TableStore, targets: bool) -> dict[str, tuple[str, ...]]:
    """Scenes of each split that has any; with ``targets`` only those that have a prediction target."""
    scenes = tables.index["scenes"]
    return splits_of([name for name, counts in scenes.items() if not targets or counts["targets"]])


def scene_truth(arrays: Arrays, time: Floats, classes: Sequence[str], listed: bool) -> Truth:
    """Truth of a scene from its cached arrays; ``listed``: of listed objects only, whose listed rows are eligible."""
    class_id = class_ids(CLASSES, classes)[arrays["class_id"]]
    keep, neutral, eligible = class_id >= 0, arrays["neutral"], np.ones(len(class_id), dtype=bool)
    if listed:
        known = np.isin(arrays["object_id"], arrays["object_id"][arrays["listed"]])
        keep, neutral, eligible = keep & known, neutral & ~known, arrays["listed"]
    row = np.flatnonzero(keep)
    frame = Ragged(arrays["start"]).frame_of_rows[row]
    box, object_id = arrays["box"][row], arrays["object_id"][row]
    return Truth(
        start=starts_of_sorted(frame, len(time)),
        box=box,
        velocity=backward_velocity(frame, object_id, box[:, :2], time),
        class_id=class_id[row],
        object_id=object_id,
        eligible=eligible[row],
        neutral=neutral[row],
    )


def _names(card: Card, root: Path, splits: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Scenes of the card's split; DataError that names the splits there are, if it has none."""
    section = section_of(card, NuScenesSource)
    names = splits.get(section.split, ())
    if names:
        return names
    if not splits:
        what = " with prediction targets" if section.truth == "targets" else ""
        raise DataError(f"{root / section.version} has no scene{what}")
    raise DataError(
        f"{root / section.version} has no scene of split {section.split!r}; it has {counted(splits)}; "
        "choose one with --split or split="
    )


def _check_hash(card: Card, stores: Sequence[DetectionStore]) -> None:
    """The file that the card names is the one it means."""
    expected = section_of(card, NuScenesSource).detections_sha256
    for store in stores:
        if expected is not None and store.digest != expected:
            raise DataError(
                f"{store.path} has the sha256 {store.digest}, expected {expected}: the detections of {card.id}"
            )
