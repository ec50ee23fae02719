"""What of WILDTRACK is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...cards import Card, instead_of_stored
from ..base import section_of
from ..dataset import DataStatus
from .files import read_annotations, read_detections
from .section import WildtrackSource
from .source import ANNOTATIONS, DATASET, DETECTIONS, FRAMES, SCENE_FRAMES, SCENES, SPLITS, STEP, needs_detections

TOTALS = {"frames": FRAMES, "annotations": 9518, "people": 313, "detections": 966}


def wildtrack_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs, and counts over all files beside the known totals."""
    section = section_of(card, WildtrackSource)

    def inspect(found: DataStatus) -> None:
        numbers = [SCENES[scene] + STEP * t for scene in SPLITS[section.split] for t in range(SCENE_FRAMES)]
        found.require_all(ANNOTATIONS, [f"{number:08d}.json" for number in numbers])
        if needs_detections(card):
            found.require(DETECTIONS)
            found.note_detector(instead_of_stored(card))
        if section.detector is not None:
            found.notes.append(
                f"detections only for the last {SCENE_FRAMES} frames; the other frames have simulated ones"
            )
        _count(found)

    return DATASET.status(data, ANNOTATIONS, inspect)


def _count(found: DataStatus) -> None:
    names = sorted(path.name for path in (found.folder / ANNOTATIONS).glob("*.json"))
    frames = [found.attempt(read_annotations, f"{ANNOTATIONS}/{name}") for name in names]
    people = np.concatenate([np.zeros(0, dtype=np.int64), *(frame.person for frame in frames if frame is not None)])
    detections = found.attempt(read_detections, DETECTIONS)
    stored = 0 if detections is None else len(detections.frame)
    found.count(TOTALS, (len(names), len(people), len(np.unique(people)), stored))
