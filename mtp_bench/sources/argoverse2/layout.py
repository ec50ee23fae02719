"""Argoverse 2 in a card and in a folder: the section ``[source]``, official categories, logs and detection files."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from pydantic import Field

from ...cards import STORED_DETECTOR, Card, DetectionsSection, Traits
from ...core import DataError, toml_beside
from ..base import DataRoot, own_detections, section_of
from ..dataset import Dataset

LOGS = "sensor/*"  # folders of the splits
DETECTIONS = "detections/*.feather"
DATASET = Dataset.of(__file__)
NEUTRAL = "neutral "  # before the class that a detector reports
# official -> class, neutral or skipped
CATEGORIES: Mapping[str, str] = MappingProxyType(
    toml_beside(__file__, "categories.toml")
)
CLASSES = tuple(
    dict.fromkeys(
        word
        for word in CATEGORIES.values()
        if word != "skipped" and NEUTRAL not in word
    )
)


class Argoverse2Source(DetectionsSection):
    """Argoverse 2 sensor logs: real boxes where a file of detections has the log, simulated ones elsewhere.

    Simulated detections are those of the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] | None = "megvii-av2"
    # of the files of detections: one whose settings agents know, a hyphen and a word; None: simulated everywhere
    stride: Annotated[int, Field(ge=1, le=20)] = 5  # keep every n-th sweep of 10 Hz
    reach: Annotated[float, Field(gt=0, le=300)] = (
        60.0  # m from the ego: what lies beyond is neither true nor detected
    )
    min_detection_score: float = (
        0.1  # least score in ``detections/``; a file that is named has its own
    )

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="" if self.detections_sha256 else "most of Argoverse 2",
            mixed_detections=True,
            detection_file="a .feather file in the form of Argoverse 2's detection submission",
            lanes=True,
        )


def log_folders(root: Path, split: str) -> dict[str, Path]:
    """Folders of the logs of a split by name; raises DataError for a split without logs."""
    paths = sorted((root / "sensor" / split).glob("*/annotations.feather"))
    if not paths:
        splits = sorted(
            {
                path.parents[1].name
                for path in root.glob(f"{LOGS}/*/annotations.feather")
            }
        )
        found = f"splits with logs: {', '.join(splits) or 'none'}"
        raise DataError(
            f"{root / 'sensor' / split} has no folder with annotations.feather; {found}"
        )
    return {path.parent.name: path.parent for path in paths}


def detection_files(root: Path, card: Card) -> tuple[Path, ...]:
    """Files of detections of the card: the one that it names, else all that there are; empty for simulated ones."""
    own = own_detections(card)
    if own is not None:
        return (own,)
    return (
        tuple(sorted(root.glob(DETECTIONS)))
        if section_of(card, Argoverse2Source).detector
        else ()
    )


def log_folder(card: Card, data: DataRoot, log: str) -> Path:
    """Folder of a log of the card's split."""
    return log_folders(DATASET.find(data, LOGS), card.source.split)[log]
