"""KITTI tracking in a card and in a folder: ``[source]``, splits and detections."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from ...cards import Card, DetectionsSection, Traits, instead_of_stored
from ...core import MissingDataError
from ..base import detections_folder, own_detections, section_of
from ..dataset import Dataset
from .files import read_sequence_map

SEQUENCE_MAP = "evaluate_tracking.seqmap.val"
# AB3DMOT's split, for a root without the sequence map
VALIDATION = (
    "0001",
    "0006",
    "0008",
    "0010",
    "0012",
    "0013",
    "0014",
    "0015",
    "0016",
    "0018",
    "0019",
)
# label type, detection code
TYPES = {"car": ("Car", 2), "pedestrian": ("Pedestrian", 1), "cyclist": ("Cyclist", 3)}
LABELS = "training/label_02"
IMAGES = "training/image_02"  # shown beside an event
DATASET = Dataset.of(__file__)
RENAME = (
    "; a recording of your own needs a name that no official sequence has, such as "
    "7001, in all folders"
)


class KittiSource(DetectionsSection):
    """KITTI tracking logs with stored detections."""

    splits = ("train", "val")

    detector: str = "pointrcnn"  # folder under detections/
    # False: every frame in its own camera frame, as without ego-motion compensation
    ego_motion: bool = True
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


def split_names(root: Path, split: str) -> tuple[str, ...]:
    """Return the sequences of a split.

    Validation: those of the sequence map, if there is one; training: every other
    sequence that has labels.
    """
    validation = tuple(read_sequence_map(root / SEQUENCE_MAP)) or VALIDATION
    if split == "val":
        return validation
    labelled = {path.stem for path in (root / LABELS).glob("*.txt")}
    return tuple(sorted(labelled.difference(validation)))


def require_detector(root: Path, card: Card) -> Path:
    """Return the folder of the card's detections.

    Raises DataError unless it is complete.
    """
    own_folder = own_detections(card)
    if own_folder is not None:
        return own_folder
    folder = detections_folder(root, card, DATASET)
    detector = section_of(card, KittiSource).detector
    names = sorted(path.name for path in folder.iterdir() if path.is_dir())
    if detector not in names:
        raise MissingDataError(
            f"{folder} has no detector {detector!r}; found: "
            f"{', '.join(names) or 'none'}{instead_of_stored(card)}"
        )
    for name in card.task.classes:
        path = folder / detector / TYPES[name][0]
        if not path.is_dir():
            raise MissingDataError(f"no folder {path}, expected for class {name!r}")
    return folder / detector
