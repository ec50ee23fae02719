"""nuScenes in a card and in a folder: the section ``[source]``, official names, tables and detection files."""

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
from ..base import own_detections, section_of
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
PREDICTION = "maps/prediction/prediction_scenes.json"  # targets of the prediction challenge, in all versions
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
CLASSES: tuple[str, ...] = get_args(
    ClassName
)  # class_id in the cache is an index into these

_CATEGORIES = toml_beside(__file__, "classes.toml")
CLASS_OF: dict[str, str] = _CATEGORIES["evaluated"]
NEUTRAL_OF: dict[str, str] = _CATEGORIES["neutral"]

SPLITS = ("train", "train_val", "val", "mini_train", "mini_val")
TRAIN_VAL = 200  # scenes: the prediction challenge validates on the first of the official "train"


class NuScenesSource(DetectionsSection):
    """nuScenes logs (official v1.0 tables) with stored detections in the official submission form."""

    splits = ("train", "train_val", "val", "mini_train", "mini_val", "all")

    version: Annotated[str, Field(pattern=r"^v1\.0-[A-Za-z0-9_.-]+$")] = (
        "v1.0-trainval"  # folder of the tables
    )
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = (
        "megvii"  # detections/<detector>*.json
    )
    velocity: bool = (
        False  # show the velocities of the detections, if the file has them
    )
    truth: Literal["targets", "all"] = "all"
    # "targets": the official prediction split names the targets, and other objects are unknown; "all": every box

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
    """The table files of a version by name; raises DataError where the version or a table is missing."""
    if not (root / version).is_dir():
        found = (
            ", ".join(
                sorted(path.name for path in root.glob(VERSIONS) if path.is_dir())
            )
            or "none"
        )
        raise MissingDataError(f"{root} has no folder {version!r}; found: {found}")
    paths = {name: root / version / f"{name}.json" for name in TABLES}
    for path in paths.values():
        if not path.is_file():
            raise MissingDataError(
                f"no file {path}: this table of {version} is missing; unpack the metadata again"
            )
    return paths


def require_maps(root: Path, card: Card) -> None:
    """Raise DataError if the card needs the list of prediction targets, or lanes, and they are missing."""
    pack = "the map expansion pack (v1.3) of https://www.nuscenes.org/nuscenes#download, to be unpacked into maps/"
    if (
        section_of(card, NuScenesSource).truth == "targets"
        and not (root / PREDICTION).is_file()
    ):
        targets = "the targets of the prediction challenge, which come with"
        raise MissingDataError(
            f"no file {root / PREDICTION}: {card.id} needs {targets} {pack}"
        )
    if card.lanes is not None and not any((root / EXPANSION).glob("*.json")):
        raise MissingDataError(
            f"no file {root / EXPANSION}/*.json: {card.id} shows lanes, which come with {pack}"
        )


def detection_paths(root: Path, card: Card) -> tuple[Path, ...]:
    """Detection files of the card: the one that it names, else all of its detector; empty for a simulated one.

    Raises DataError if there are no files, naming those of other detectors.
    """
    if card.detector is not None:
        return ()
    if (own := own_detections(card)) is not None:
        return (own,)
    section = section_of(card, NuScenesSource)
    folder = root / "detections"
    if not folder.is_dir():
        raise MissingDataError(
            f"no folder {folder}{instead_of_stored(card)}; to get them: {DATASET.how_to_get}"
        )
    paths = tuple(
        sorted(
            path
            for path in folder.glob(f"{glob.escape(section.detector)}*.json")
            if path.is_file()
        )
    )
    if not paths:
        names = sorted(path.name for path in folder.glob("*.json") if path.is_file())
        found = f"found: {', '.join(names) or 'none'}{instead_of_stored(card)}"
        raise MissingDataError(
            f"{folder} has no file {section.detector}*.json; {found}"
        )
    return paths


@cache
def official_scenes() -> Mapping[str, tuple[str, ...]]:
    """Scene names of each of `SPLITS`, in the official order (``nuscenes.eval.prediction.splits``)."""
    lists = json.loads(
        Path(__file__).with_name("splits.json").read_text(encoding="utf-8")
    )
    train = lists["train"]
    named = {**lists, "train": train[TRAIN_VAL:], "train_val": train[:TRAIN_VAL]}
    return MappingProxyType({split: tuple(named[split]) for split in SPLITS})


def scenes_by_split(scenes: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The ``scenes`` of each split that has any, in its order; "all", the last, has every one, sorted."""
    there = frozenset(scenes)
    named = {
        split: tuple(name for name in names if name in there)
        for split, names in official_scenes().items()
    }
    return {
        split: names
        for split, names in {**named, "all": tuple(sorted(scenes))}.items()
        if names
    }
