"""What of KITTI tracking is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...cards import Card, instead_of_stored
from ...types import Ints
from ..base import section_of
from ..dataset import DataStatus
from .files import Labels, read_labels, read_oxts, read_sequence_map
from .layout import DATASET, IMAGES, LABELS, SEQUENCE_MAP, TYPES, VALIDATION
from .section import KittiSource

SEQUENCES = tuple(f"{i:04d}" for i in range(21))
# Known totals: all training sequences, then the validation split (boxes and tracks of each type).
TOTALS = {"sequences": 21, "frames": 8008, "tracks": 917, "boxes": 47262}
VALIDATION_TOTALS = {
    "validation frames": 3908,
    "validation Car boxes": 9550,
    "validation Car tracks": 190,
    "validation Pedestrian boxes": 10124,
    "validation Pedestrian tracks": 142,
    "validation Cyclist boxes": 1409,
    "validation Cyclist tracks": 28,
}


def kitti_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs, and counts over the label files beside the known totals."""

    def inspect(found: DataStatus) -> None:
        validation = tuple(found.attempt(read_sequence_map, SEQUENCE_MAP) or VALIDATION)
        training = tuple(name for name in SEQUENCES if name not in validation)
        names = validation if section_of(card, KittiSource).split == "val" else training
        _require(found, card, names)
        if not (found.folder / SEQUENCE_MAP).is_file():
            found.notes.append(f"{SEQUENCE_MAP} is missing: the validation split is taken as {', '.join(VALIDATION)}")
        if "0019" in names and not (found.folder / "poses_orbslam3/0019.txt").is_file():
            found.notes.append(
                "poses_orbslam3/0019.txt is missing: sequence 0019 uses its GPS/IMU unit, which is bad there"
            )
        if not (found.folder / IMAGES).is_dir():
            found.notes.append(
                f"{IMAGES}/ is missing, so pictures of events show no image: the left colour images are in "
                "data_tracking_image_2.zip of https://www.cvlibs.net/datasets/kitti/eval_tracking.php"
            )
        _count(found, validation)

    return DATASET.status(data, LABELS, inspect)


def _require(found: DataStatus, card: Card, names: tuple[str, ...]) -> None:
    """Note what the card needs and is not there."""
    section = section_of(card, KittiSource)
    folders = [LABELS, "training/calib", "training/oxts"]
    if card.detector is None and section.detections_file is None:
        stored = f"detections/{section.detector}"
        folders += [f"{stored}/{TYPES[name][0]}" for name in card.task.classes if name in TYPES]
    for folder in folders:
        found.require_all(folder, [f"{name}.txt" for name in names])
    found.note_detector(instead_of_stored(card))


def _count(found: DataStatus, validation: tuple[str, ...]) -> None:
    """Counts over all sequences that are there and over those of the validation split."""
    labels: dict[str, Labels] = {}
    frames: dict[str, int] = {}
    for name in SEQUENCES:
        rows = found.attempt(read_labels, f"{LABELS}/{name}.txt")
        oxts = found.attempt(read_oxts, f"training/oxts/{name}.txt")
        if rows is not None:
            labels[name] = rows
        if oxts is not None:
            frames[name] = len(oxts.attitude)
    objects = [_boxes_and_tracks(rows.object_id[rows.type != "DontCare"]) for rows in labels.values()]
    boxes, tracks = (sum(counts) for counts in zip(*objects, strict=True)) if objects else (0, 0)
    found.count(TOTALS, (len(labels), sum(frames.values()), tracks, boxes))
    within = [labels[name] for name in validation if name in labels]
    numbers = [sum(frames.get(name, 0) for name in validation)]
    for kind in ("Car", "Pedestrian", "Cyclist"):
        counts = [_boxes_and_tracks(rows.object_id[rows.type == kind]) for rows in within]
        numbers += [sum(boxes for boxes, _ in counts), sum(tracks for _, tracks in counts)]
    found.count(VALIDATION_TOTALS, numbers)


def _boxes_and_tracks(object_id: Ints) -> tuple[int, int]:
    return len(object_id), len(np.unique(object_id))
