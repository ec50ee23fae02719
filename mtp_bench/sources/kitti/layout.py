"""KITTI tracking in a card and in a folder: the section ``[source]``, the splits and the detections."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from ...cards import Card, instead_of_stored
from ...cards.own import TEXTS, folder_digest
from ...cards.source import LocalPath, SourceSection, Traits
from ...errors import DataError
from ..base import section_of
from ..dataset import Dataset
from .files import read_sequence_map

SEQUENCE_MAP = "evaluate_tracking.seqmap.val"
# The paper's validation sequences (AB3DMOT's split), for a root without the sequence map.
VALIDATION = ("0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019")
TYPES = {"car": ("Car", 2), "pedestrian": ("Pedestrian", 1), "cyclist": ("Cyclist", 3)}  # label type, detection code
LABELS = "training/label_02"
IMAGES = "training/image_02"  # shown beside an event
DATASET = Dataset.of(__file__)


class KittiSource(SourceSection):
    """KITTI tracking logs with stored detections."""

    splits = ("train", "val")

    detector: str = "pointrcnn"  # folder under detections/
    detections_sha256: str | None = None  # of a folder that replaces the detector's; see cards.with_detections
    detections_file: LocalPath = None  # that folder
    ego_motion: bool = True  # False: every frame in its own camera frame, as without ego-motion compensation
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame

    @property
    def traits(self) -> Traits:
        """What the source can do."""
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
    section = section_of(card, KittiSource)
    if section.detections_file is not None or section.detections_sha256 is not None:
        return _own_detections(card, section)
    folder = root / "detections"
    if not folder.is_dir():
        raise DataError(f"no folder {folder}{instead_of_stored(card)}; to get them: {DATASET.how_to_get}")
    found = sorted(path.name for path in folder.iterdir() if path.is_dir())
    if section.detector not in found:
        listed = ", ".join(found) or "none"
        raise DataError(f"{folder} has no detector {section.detector!r}; found: {listed}{instead_of_stored(card)}")
    for name in card.task.classes:
        if not (folder / section.detector / TYPES[name][0]).is_dir():
            raise DataError(f"no folder {folder / section.detector / TYPES[name][0]}, expected for class {name!r}")
    return folder / section.detector


def _own_detections(card: Card, section: KittiSource) -> Path:
    """The folder of detections that replaces those of the detector's; see `cards.with_detections`."""
    if section.detections_file is None:
        raise DataError(
            f"{card.id} has the detections of a folder with sha256 {section.detections_sha256}: "
            "name it with --detections"
        )
    folder = Path(section.detections_file)
    if not folder.is_dir():
        expected = f"{section.traits.detection_file}: 0001.txt, ..., or Car/0001.txt, ..."
        raise DataError(f"{folder} is not a folder, expected {expected}")
    if section.detections_sha256 not in (None, folder_digest(folder, TEXTS)):
        raise DataError(f"{folder}: its files were changed since {card.id} was made with them; run the agent again")
    return folder
