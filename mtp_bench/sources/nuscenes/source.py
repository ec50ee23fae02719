"""nuScenes logs with stored detections, from the official tables."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene, Truth
from ..base import (
    DataRoot,
    Work,
    class_ids,
    names_by_number,
    no_detections,
    require_classes,
    require_rate,
    section_of,
)
from ..cache import Arrays
from ..motion import looking_back, unknown_velocity
from .layout import (
    CLASSES,
    DATASET,
    VERSIONS,
    NuScenesSource,
    detection_paths,
    require_maps,
    scenes_by_split,
)
from .store import open_tables
from .submission import open_detections, scene_detections
from .tables import SECOND

RATE = 2.0  # Hz of the keyframes, nominal


class NuScenes:
    """Scenes of one split of nuScenes, in the global frame of their map.

    Frames are the keyframes at their real times, from 0. The ego is the LIDAR_TOP pose of each. With ``truth =
    "targets"`` only the objects that the prediction challenge names in a scene are in its truth.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, NuScenesSource)
        require_classes(card, DATASET.name, CLASSES)
        require_rate(card, DATASET.name, RATE)
        self.root = DATASET.find(data, VERSIONS)
        require_maps(self.root, card)
        paths = detection_paths(self.root, card)
        self.tables = open_tables(self.root, self.section.version)
        targets = self.tables.targets if self.section.truth == "targets" else None
        listed = (
            name
            for i, name in enumerate(self.tables.scenes)
            if targets is None or targets[i]
        )
        splits = scenes_by_split(
            tuple(listed)
        )  # with targets alone: only the scenes that have one
        self.names = splits.get(self.section.split, ())
        if not self.names:
            found = (
                ", ".join(f"{split} ({len(names)})" for split, names in splits.items())
                or "none"
            )
            needed = (
                " with prediction targets" if self.section.truth == "targets" else ""
            )
            raise DataError(
                f"{self.root / self.section.version} has no scene of split {self.section.split!r}{needed}; splits "
                f"with scenes: {found}; choose one with --split or split="
            )
        self.detections = open_detections(paths, self.tables, self.names)

    def load(self, name: str) -> Scene:
        """Read one scene from the cache."""
        arrays, classes = self.tables.cache.read(name), self.card.task.classes
        time = (arrays["time"] - arrays["time"][0]) / SECOND
        detections, label = no_detections(len(time)), ""
        if self.detections:
            label = f"{self.section.detector}, stored detections"
            detections = scene_detections(
                self.detections, self.tables.samples(name), name, classes
            )
        listed = self.section.truth == "targets"
        truth = scene_truth(arrays, time, classes, listed)
        names = names_by_number(truth.object_id, arrays["instance"][truth.object_id])
        scene = Scene(
            name,
            time,
            arrays["ego"],
            truth,
            detections,
            detector=label,
            object_names=names,
        )
        return replace(scene, truth_complete=not listed, listed_targets=listed)


def prepare_nuscenes(
    card: Card, data: DataRoot, scenes: int | None, workers: int
) -> Work:
    """Make the compact copy of the tables and detections of ``card`` if it is missing; one piece of work.

    Raises DataError for everything that stops the card's scenes from being read.
    """
    return 1, (NuScenes(card, data).section.version for _ in range(1))


def scene_truth(
    arrays: Arrays, time: Floats, classes: Sequence[str], listed: bool
) -> Truth:
    """Truth of a scene from its cached arrays; ``listed``: of listed objects only, whose listed rows are eligible."""
    class_id = class_ids(CLASSES, classes)[arrays["class_id"]]
    keep, neutral, eligible = (
        class_id >= 0,
        arrays["neutral"],
        np.ones(len(class_id), dtype=bool),
    )
    if listed:
        known = np.isin(arrays["object_id"], arrays["object_id"][arrays["listed"]])
        keep, neutral, eligible = keep & known, neutral & ~known, arrays["listed"]
    start, box, object_id = (arrays[name] for name in ("start", "box", "object_id"))
    truth = Truth(
        start, box, unknown_velocity(len(box)), class_id, object_id, eligible, neutral
    ).select(keep)
    return looking_back(truth, time, 1 / RATE)
