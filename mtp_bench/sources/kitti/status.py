"""Files of KITTI tracking that a card needs, and counts over them, for ``mtp-bench data``."""

from __future__ import annotations

import numpy as np

from ...cards import Card, instead_of_stored
from ...types import Ints
from ..base import section_of
from ..dataset import DataStatus
from .files import Labels, read_labels, read_oxts, read_sequence_map
from .layout import IMAGES, LABELS, SEQUENCE_MAP, TYPES, VALIDATION, KittiSource

SEQUENCES = tuple(f"{i:04d}" for i in range(21))


def inspect(card: Card, found: DataStatus) -> None:
    """Note the files that ``card`` needs, and count over the label files."""
    section = section_of(card, KittiSource)
    validation = tuple(found.attempt(read_sequence_map, SEQUENCE_MAP) or VALIDATION)
    training = tuple(name for name in SEQUENCES if name not in validation)
    names = validation if section.split == "val" else training
    folders = [LABELS, "training/calib", "training/oxts"]
    if card.detector is None and section.detections_file is None:
        stored = f"detections/{section.detector}"
        folders += [f"{stored}/{TYPES[name][0]}" for name in card.task.classes if name in TYPES]
    for folder in folders:
        found.require_all(folder, [f"{name}.txt" for name in names])
    found.note_detector(instead_of_stored(card))
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
    boxes, tracks = _boxes_and_tracks([rows.object_id[rows.type != "DontCare"] for rows in labels.values()])
    counts = {"sequences": len(labels), "frames": sum(frames.values()), "tracks": tracks, "boxes": boxes}
    counts["validation frames"] = sum(frames.get(name, 0) for name in validation)
    within = [labels[name] for name in validation if name in labels]
    for kind in ("Car", "Pedestrian", "Cyclist"):
        boxes, tracks = _boxes_and_tracks([rows.object_id[rows.type == kind] for rows in within])
        counts |= {f"validation {kind} boxes": boxes, f"validation {kind} tracks": tracks}
    found.count(counts, found.about.totals)


def _boxes_and_tracks(ids: list[Ints]) -> tuple[int, int]:
    """Numbers of boxes and of tracks by the ids of each sequence."""
    return sum(map(len, ids)), sum(len(np.unique(own)) for own in ids)
