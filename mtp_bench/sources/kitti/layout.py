"""KITTI tracking in a card and in a folder: the section ``[source]``, splits, detections, status of the files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from ...cards import Card, instead_of_stored
from ...cards.source import DetectionsSection, Traits
from ...errors import DataError
from ...types import Ints
from ..base import own_detections, section_of
from ..dataset import Dataset, DataStatus
from .files import LabelRows, read_labels, read_oxts, read_sequence_map

SEQUENCE_MAP = "evaluate_tracking.seqmap.val"
# The paper's validation sequences (AB3DMOT's split), for a root without the sequence map.
VALIDATION = ("0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019")
TYPES = {"car": ("Car", 2), "pedestrian": ("Pedestrian", 1), "cyclist": ("Cyclist", 3)}  # label type, detection code
LABELS = "training/label_02"
IMAGES = "training/image_02"  # shown beside an event
SEQUENCES = tuple(f"{i:04d}" for i in range(21))
DATASET = Dataset.of(__file__)


class KittiSource(DetectionsSection):
    """KITTI tracking logs with stored detections."""

    splits = ("train", "val")

    detector: str = "pointrcnn"  # folder under detections/
    ego_motion: bool = True  # False: every frame in its own camera frame, as without ego-motion compensation
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector,
            detection_file="a folder of KITTI text, one file per sequence",
            velocity_ahead=True,
            common_frame=self.ego_motion,
            view=90.0,  # of the labels' camera
        )


def validation_lengths(root: Path) -> dict[str, int]:
    """Frames of the validation sequences by the sequence map; empty without one."""
    path = root / SEQUENCE_MAP
    return read_sequence_map(path) if path.is_file() else {}


def split_names(root: Path, split: str, lengths: dict[str, int]) -> tuple[str, ...]:
    """Validation: the sequence map; training: every other sequence that has labels."""
    validation = tuple(lengths) or VALIDATION
    if split == "val":
        return validation
    labelled = sorted(path.stem for path in (root / LABELS).glob("*.txt"))
    return tuple(name for name in labelled if name not in validation)


def require_detector(root: Path, card: Card) -> Path:
    """The folder of the card's detections; raises DataError unless it is there with all classes."""
    own, section = own_detections(card), section_of(card, KittiSource)
    if own is not None:
        return own
    folder = root / "detections"
    if not folder.is_dir():
        raise DataError(f"no folder {folder}{instead_of_stored(card)}; to get them: {DATASET.how_to_get}")
    names = sorted(path.name for path in folder.iterdir() if path.is_dir())
    if section.detector not in names:
        listed = ", ".join(names) or "none"
        raise DataError(f"{folder} has no detector {section.detector!r}; found: {listed}{instead_of_stored(card)}")
    for name in card.task.classes:
        if not (folder / section.detector / TYPES[name][0]).is_dir():
            raise DataError(f"no folder {folder / section.detector / TYPES[name][0]}, expected for class {name!r}")
    return folder / section.detector


def inspect(card: Card, status: DataStatus) -> None:
    """Note the files that ``card`` needs, and count over the label files."""
    section = section_of(card, KittiSource)
    validation = tuple(status.attempt(read_sequence_map, SEQUENCE_MAP) or VALIDATION)
    training = tuple(name for name in SEQUENCES if name not in validation)
    names = validation if section.split == "val" else training
    folders = [LABELS, "training/calib", "training/oxts"]
    if card.detector is None and section.detections_file is None:
        stored = f"detections/{section.detector}"
        folders += [f"{stored}/{TYPES[name][0]}" for name in card.task.classes if name in TYPES]
    for folder in folders:
        status.require_all(folder, [f"{name}.txt" for name in names])
    status.note_detector(instead_of_stored(card))
    if not (status.folder / SEQUENCE_MAP).is_file():
        status.notes.append(f"{SEQUENCE_MAP} is missing: the validation split is taken as {', '.join(VALIDATION)}")
    if "0019" in names and not (status.folder / "poses_orbslam3/0019.txt").is_file():
        status.notes.append(
            "poses_orbslam3/0019.txt is missing: sequence 0019 uses its GPS/IMU unit, which is bad there"
        )
    if not (status.folder / IMAGES).is_dir():
        status.notes.append(
            f"{IMAGES}/ is missing, so pictures of events show no image: the left colour images are in "
            "data_tracking_image_2.zip of https://www.cvlibs.net/datasets/kitti/eval_tracking.php"
        )
    _count(status, validation)


def _count(status: DataStatus, validation: tuple[str, ...]) -> None:
    """Counts over all sequences that are there and over those of the validation split."""
    labels: dict[str, LabelRows] = {}
    frames: dict[str, int] = {}
    for name in SEQUENCES:
        rows = status.attempt(read_labels, f"{LABELS}/{name}.txt")
        oxts = status.attempt(read_oxts, f"training/oxts/{name}.txt")
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
    status.count(counts, status.about.totals)


def _boxes_and_tracks(ids: list[Ints]) -> tuple[int, int]:
    """Numbers of boxes and of tracks by the ids of each sequence."""
    return sum(map(len, ids)), sum(len(np.unique(own)) for own in ids)
