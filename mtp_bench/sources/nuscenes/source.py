"""nuScenes logs with stored detections, from the official tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import CardError, DataError, UnknownNameError, nearest
from ...types import Floats, Scene, Truth
from ..base import no_detections
from ..cache import Arrays
from ..motion import backward_velocity
from .classes import CLASSES
from .detections import DetectionStore, bytes_left, class_ids, open_detections, require_covered, scene_detections
from .layout import detection_paths, find_root, require_prediction, section_of
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
        self.section = section_of(card)
        _check_task(card)
        self.root = find_root(data)
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


def prepare_nuscenes(
    card: Card,
    data: str | Path | None = None,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> None:
    """Make the compact copy of the tables and detections of ``card`` where it is not there.

    ``started`` is told the number of pieces of work, ``progress`` the name of the file at each piece that is done.
    Raises DataError for everything that stops the card's scenes from being read.
    """
    NuScenes(card, data, started, progress)


def available_splits(tables: TableStore, targets: bool) -> dict[str, tuple[str, ...]]:
    """Scenes of each split that has any; with ``targets`` only those that have a prediction target."""
    scenes = tables.index["scenes"]
    return splits_of([name for name, counts in scenes.items() if not targets or counts["targets"]])


def scene_truth(arrays: Arrays, time: Floats, classes: Sequence[str], listed: bool) -> Truth:
    """Truth of a scene from its cached arrays; ``listed``: of listed objects only, whose listed rows are eligible."""
    class_id = class_ids(classes)[arrays["class_id"]]
    keep, neutral, eligible = class_id >= 0, arrays["neutral"], np.ones(len(class_id), dtype=bool)
    if listed:
        known = np.isin(arrays["object_id"], arrays["object_id"][arrays["listed"]])
        keep, neutral, eligible = keep & known, neutral & ~known, arrays["listed"]
    row = np.flatnonzero(keep)
    frame = np.repeat(np.arange(len(time)), np.diff(arrays["start"]))[row]
    box, object_id = arrays["box"][row], arrays["object_id"][row]
    return Truth(
        start=np.searchsorted(frame, np.arange(len(time) + 1)),
        box=box,
        velocity=backward_velocity(frame, object_id, box[:, :2], time),
        class_id=class_id[row],
        object_id=object_id,
        eligible=eligible[row],
        neutral=neutral[row],
    )


def _check_task(card: Card) -> None:
    for name in card.task.classes:
        if name not in CLASSES:
            raise CardError(f"{card.id}: nuScenes has no class {name!r}{nearest(name, CLASSES)}")
    if card.task.rate != RATE:
        raise CardError(f"{card.id}: task.rate is {card.task.rate:g} Hz, but nuScenes has keyframes at {RATE:g} Hz")


def _names(card: Card, root: Path, splits: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Scenes of the card's split; DataError that names the splits there are, if it has none."""
    section = section_of(card)
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
    expected = section_of(card).detections_sha256
    for store in stores:
        if expected is not None and store.digest != expected:
            raise DataError(
                f"{store.path} has the sha256 {store.digest}, expected {expected}: the detections of {card.id}"
            )
