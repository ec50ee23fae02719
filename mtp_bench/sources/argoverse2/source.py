"""Argoverse 2 sensor logs as scenes: truth within reach, and the boxes of detection files that have the log."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...cards import Card
from ...core import DataError, Detections, Scene, Truth, starts_of_sorted
from ..base import (
    DataRoot,
    names_by_number,
    no_detections,
    require_classes,
    require_rate,
    section_of,
)
from ..motion import looking_back, unknown_velocity
from ..stored_tracks import FEWER
from ..text import SMALLEST, repeated
from .feather import ANNOTATIONS, RATE, Sweeps
from .layout import (
    CATEGORIES,
    CLASSES,
    DATASET,
    LOGS,
    NEUTRAL,
    Argoverse2Source,
    detection_files,
    log_folders,
)
from .submission import read_boxes, read_detections


class Argoverse2:
    """Logs of one split, named by their ids, in the frame of their city less an origin in whole metres.

    Frames are every ``stride``-th sweep at their real times, from 0. The truth of an object begins where it first comes
    within reach; where it is beyond later, or has no lidar point, it is neutral.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, Argoverse2Source)
        require_classes(card, DATASET.name, CLASSES)
        require_rate(card, DATASET.name, RATE, self.section.stride)
        root = DATASET.find(data, LOGS)
        self.folders = log_folders(root, self.section.split)
        self.names = tuple(self.folders)
        self._files = detection_files(root, card)

    def load(self, name: str) -> Scene:
        """Read one log; if it has no stored detections, ``detector`` is empty."""
        sweeps = Sweeps.read(self.folders[name], self.section.stride)
        truth, names = scene_truth(sweeps, self.card)
        none = no_detections(len(sweeps.time))
        scene = Scene(name, sweeps.time, sweeps.ego, truth, none, object_names=names)
        return self._detected(scene, sweeps)

    def _detected(self, scene: Scene, sweeps: Sweeps) -> Scene:
        """The scene with the stored detections of its log, if any.

        A file of ``detections/`` with boxes in less than half of the frames has another rate and is passed over.
        """
        own, having = (
            self.section.detections_sha256 is not None,
            dict[str, Detections](),
        )
        for path in self._files:
            seen = read_detections(path, sweeps, self.card)
            frames = int((seen.counts > 0).sum())
            if 2 * frames >= scene.frames:
                having[str(path)] = (
                    seen
                    if own
                    else seen.select(seen.score >= self.section.min_detection_score)
                )
            elif own:
                few = f"{path} has detections in {frames} of the {scene.frames} frames of log {scene.name}"
                raise DataError(f"{few}, expected most; {FEWER}")
        if len(having) > 1:
            both = " and ".join(having)
            raise DataError(
                f"{both} both have detections of log {scene.name}; name one of them with --detections"
            )
        for file, seen in having.items():
            return replace(
                scene, detections=seen, detector=f"{Path(file).stem}, stored detections"
            )
        return scene


def scene_truth(sweeps: Sweeps, card: Card) -> tuple[Truth, dict[int, str]]:
    """Truth of a log, and the names of its objects; raises DataError for annotations that are wrong."""
    path = sweeps.folder / ANNOTATIONS
    table, frame, class_id, box, near = read_boxes(
        path, sweeps, card, "num_interior_pts", "track_uuid"
    )
    name = table.words["track_uuid"]
    table.refuse(
        repeated(frame, name),
        "a second box of this object in its sweep, expected one",
        "track_uuid",
    )
    table.refuse(
        np.asarray((box[:, 4:] < SMALLEST).any(axis=1)),
        "a side of the box is not above 0 m",
    )
    uuid, number = np.unique(name, return_inverse=True)
    first = np.full(len(uuid), len(sweeps.stamp))
    np.minimum.at(first, number[near], frame[near])
    like = [word for word, meaning in CATEGORIES.items() if meaning.startswith(NEUTRAL)]
    neutral = (
        ~near
        | (table["num_interior_pts"] == 0)
        | np.isin(table.words["category"], like)
    )
    row = np.argsort(frame, kind="stable")
    row = row[(frame >= first[number])[row]]
    start, velocity = (
        starts_of_sorted(frame[row], len(sweeps.time)),
        unknown_velocity(len(row)),
    )
    eligible = np.ones(len(row), dtype=bool)
    truth = Truth(
        start, box[row], velocity, class_id[row], number[row], eligible, neutral[row]
    )
    return looking_back(truth, sweeps.time, sweeps.stride / RATE), names_by_number(
        number[row], name[row]
    )
