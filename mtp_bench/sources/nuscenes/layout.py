"""nuScenes in a card and in a folder: ``[source]``, official names, tables, files."""

import glob
import json
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal, get_args

from pydantic import Field

from ...cards import STORED_DETECTOR, Card, DetectionsSection, Traits, instead_of_stored
from ...core import MissingDataError, toml_beside
from ..base import detections_folder, own_detections, section_of
from ..dataset import Dataset

TABLES = (
    "scene",
    "sample",
    "sensor",
    "calibrated_sensor",
    "sample_data",
    "ego_pose",
    "category",
    "instance",
    "sample_annotation",
)
VERSIONS = "v1.0-*"  # folders of the root
# targets of the prediction challenge, in all versions
PREDICTION = "maps/prediction/prediction_scenes.json"
EXPANSION = "maps/expansion"  # a file for each location, drawn under the boxes
CAMERAS = "samples/CAM_*"  # folders of images, shown beside an event
DATASET = Dataset.of(__file__)
ClassName = Literal[
    "car",
    "truck",
    "bus",
    "trailer",
    "construction_vehicle",
    "pedestrian",
    "motorcycle",
    "bicycle",
    "traffic_cone",
    "barrier",
]
# class_id in the cache is an index into these
CLASSES: tuple[str, ...] = get_args(ClassName)

_CATEGORIES = toml_beside(__file__, "classes.toml")
CLASS_OF: dict[str, str] = _CATEGORIES["evaluated"]
NEUTRAL_OF: dict[str, str] = _CATEGORIES["neutral"]

SPLITS = ("train", "train_val", "val", "mini_train", "mini_val")
# scenes: the prediction challenge validates on the first of the official "train"
TRAIN_VAL_SCENES = 200
_EXPANSION_PACK = (
    "the map expansion pack (v1.3) of https://www.nuscenes.org/nuscenes#download, to "
    "be unpacked into maps/"
)


class NuScenesSource(DetectionsSection):
    """nuScenes logs (official v1.0 tables) with stored detections.

    Detections are in the official submission form.
    """

    splits = (*SPLITS, "all")

    # folder of the tables
    version: Annotated[str, Field(pattern=r"^v1\.0-[A-Za-z0-9_.-]+$")] = "v1.0-trainval"
    # detections/<detector>*.json
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = "megvii"
    # show the velocities of the detections, if the file has them
    velocity: bool = False
    # "targets": the official prediction split names the targets, and other objects are
    # unknown; "all": every box
    truth: Literal["targets", "all"] = "all"

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector,
            other_detections=True,
            detection_file="a JSON file in the official submission form",
            measured_velocity=self.velocity,
            truth_complete=self.truth == "all",
            lanes=True,
        )


def table_paths(root: Path, version: str) -> dict[str, Path]:
    """Return the table files of a version by name.

    Raises DataError where the version or a table is missing.
    """
    folder = root / version
    if not folder.is_dir():
        versions = [path.name for path in root.glob(VERSIONS) if path.is_dir()]
        listed = ", ".join(sorted(versions)) or "none"
        raise MissingDataError(f"{root} has no folder {version!r}; found: {listed}")
    paths = {name: folder / f"{name}.json" for name in TABLES}
    for path in paths.values():
        if not path.is_file():
            raise MissingDataError(
                f"no file {path}: this table of {version} is missing; unpack the "
                "metadata again"
            )
    return paths


def require_maps(root: Path, card: Card) -> None:
    """Raise DataError if prediction targets or lanes of the card are missing."""
    uses_targets = section_of(card, NuScenesSource).truth == "targets"
    if uses_targets and not (root / PREDICTION).is_file():
        raise MissingDataError(
            f"no file {root / PREDICTION}: {card.id} needs the targets of the "
            f"prediction challenge, which come with {_EXPANSION_PACK}"
        )
    if card.lanes is not None and not any((root / EXPANSION).glob("*.json")):
        raise MissingDataError(
            f"no file {root / EXPANSION}/*.json: {card.id} shows lanes, which come "
            f"with {_EXPANSION_PACK}"
        )


def detection_paths(root: Path, card: Card) -> tuple[Path, ...]:
    """Return the detection files of the card.

    Empty for a simulated detector. They are the one that it names, else all of its
    detector. Raises DataError if there are no files, naming those of other detectors.
    """
    if card.detector is not None:
        return ()
    own_file = own_detections(card)
    if own_file is not None:
        return (own_file,)
    folder = detections_folder(root, card, DATASET)
    detector = section_of(card, NuScenesSource).detector
    pattern = f"{glob.escape(detector)}*.json"
    paths = sorted(path for path in folder.glob(pattern) if path.is_file())
    if not paths:
        names = sorted(path.name for path in folder.glob("*.json") if path.is_file())
        raise MissingDataError(
            f"{folder} has no file {detector}*.json; found: "
            f"{', '.join(names) or 'none'}{instead_of_stored(card)}"
        )
    return tuple(paths)


@cache
def official_scenes() -> Mapping[str, tuple[str, ...]]:
    """Return the scene names of each of `SPLITS`, in the official order.

    Source: ``nuscenes.eval.prediction.splits``.
    """
    path = Path(__file__).with_name("splits.json")
    lists = json.loads(path.read_text(encoding="utf-8"))
    train = lists["train"]
    lists["train"] = train[TRAIN_VAL_SCENES:]
    lists["train_val"] = train[:TRAIN_VAL_SCENES]
    return MappingProxyType({split: tuple(lists[split]) for split in SPLITS})


def scenes_by_split(scenes: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the ``scenes`` of each split that has any, in its order.

    "all", the last, has every one, sorted.
    """
    splits: dict[str, tuple[str, ...]] = {}
    for split, names in (*official_scenes().items(), ("all", sorted(scenes))):
        existing_scenes = tuple(name for name in names if name in scenes)
        if existing_scenes:
            splits[split] = existing_scenes
    return splits
