"""Argoverse 2 in a card and in a folder: ``[source]``, categories, logs, detections."""

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
_REPORTED = [label.removeprefix(NEUTRAL) for label in CATEGORIES.values()]
CLASSES = tuple(dict.fromkeys(name for name in _REPORTED if name != "skipped"))


class Argoverse2Source(DetectionsSection):
    """Argoverse 2 sensor logs with real boxes where a file of detections has the log.

    Elsewhere the detections are simulated, by the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    # name of the detector that wrote the files: one whose settings agents know, a
    # hyphen and a word; None: simulated everywhere
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] | None = "megvii-av2"
    stride: Annotated[int, Field(ge=1, le=20)] = 5  # keep every n-th sweep of 10 Hz
    # m from the ego: what lies beyond is neither true nor detected
    reach: Annotated[float, Field(gt=0, le=300)] = 60.0
    # least score in ``detections/``; a file that is named has its own
    min_detection_score: float = 0.1

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="" if self.detections_sha256 else "most of Argoverse 2",
            mixed_detections=True,
            detection_file="a .feather file in the form of Argoverse 2's detection "
            "submission",
            lanes=True,
        )


def log_folders(root: Path, split: str) -> dict[str, Path]:
    """Return the folders of the logs of a split by name.

    Raises DataError without logs.
    """
    folder = root / "sensor" / split
    paths = sorted(folder.glob("*/annotations.feather"))
    if not paths:
        others = root.glob(f"{LOGS}/*/annotations.feather")
        splits = sorted({path.parents[1].name for path in others})
        raise DataError(
            f"{folder} has no folder with annotations.feather; splits with logs: "
            f"{', '.join(splits) or 'none'}"
        )
    return {path.parent.name: path.parent for path in paths}


def detection_files(root: Path, card: Card) -> tuple[Path, ...]:
    """Return the files of detections of the card.

    A card may name one file; otherwise all files there are returned. Empty for
    simulated detections.
    """
    own_file = own_detections(card)
    if own_file is not None:
        return (own_file,)
    if not section_of(card, Argoverse2Source).detector:
        return ()
    return tuple(sorted(root.glob(DETECTIONS)))


def log_folder(card: Card, data: DataRoot, log: str) -> Path:
    """Return the folder of a log of the card's split."""
    return log_folders(DATASET.find(data, LOGS), card.source.split)[log]
