"""Folder layout of nuScenes: the root, its version folders, the tables, the detection files."""

from __future__ import annotations

import glob
from pathlib import Path

from ...cards import Card, instead_of_stored
from ...errors import DataError
from ..base import section_of
from ..dataset import Dataset
from .section import NuScenesSource

FOLDER = "nuscenes"
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
)  # in the order of reading
VERSIONS = "v1.0-*"  # folders of the root
PREDICTION = "maps/prediction/prediction_scenes.json"
EXPANSION = "maps/expansion"  # a file for each location, drawn under the boxes
CAMERAS = "samples/CAM_*"  # folders of images, shown beside an event
DATASET = Dataset(
    name="nuScenes",
    folders=(FOLDER,),
    layout=f"""\
{FOLDER}/
  v1.0-trainval/, v1.0-mini/        a version: the official tables
    {", ".join(f"{name}.json" for name in TABLES[:5])},
    {", ".join(f"{name}.json" for name in TABLES[5:])}
  {PREDICTION}
                                    targets of the prediction challenge, for all versions
  detections/<detector>*.json       detections in the official submission form
  {EXPANSION}/<location>.json     map expansion, for pictures alone (optional)
  samples/CAM_*/*.jpg               images at the keyframes, for pictures alone (optional)""",
    licence=(
        "CC BY-NC-SA 4.0 and the nuScenes terms of use: non-commercial; "
        "detections as distributed with AB3DMOT: academic, non-commercial"
    ),
    citation=(
        "H. Caesar et al.: nuScenes: A multimodal dataset for autonomous driving. CVPR 2020; Megvii detections: "
        "B. Zhu et al.: Class-balanced grouping and sampling for point cloud 3D object detection. arXiv 2019; "
        "CenterPoint: T. Yin et al.: Center-based 3D object detection and tracking. CVPR 2021"
    ),
    how_to_get=(
        "register at https://www.nuscenes.org/nuscenes#download, download the metadata of v1.0-trainval (or the mini "
        "split, whose archive has its own) and, for prediction targets, the map expansion pack, and unpack them into "
        f"{FOLDER}/ of the data root; Megvii detections in the official submission form are on the tracking page of "
        "https://www.nuscenes.org and come with https://github.com/xinshuoweng/AB3DMOT: put them into "
        f"{FOLDER}/detections/ as megvii*.json; neither images nor point clouds are needed"
    ),
)


def versions(root: Path) -> tuple[str, ...]:
    """Names of the version folders of a root, sorted."""
    return tuple(sorted(path.name for path in root.glob(VERSIONS) if path.is_dir()))


def table_paths(root: Path, version: str) -> dict[str, Path]:
    """The table files of a version by name; raises DataError where the version or a table is missing."""
    if not (root / version).is_dir():
        raise DataError(f"{root} has no folder {version!r}; found: {', '.join(versions(root)) or 'none'}")
    paths = {name: root / version / f"{name}.json" for name in TABLES}
    for path in paths.values():
        if not path.is_file():
            raise DataError(f"no file {path}: this table of {version} is missing; unpack the metadata again")
    return paths


def prediction_path(root: Path) -> Path | None:
    """The list of prediction targets, where it is there; one file serves all versions."""
    path = root / PREDICTION
    return path if path.is_file() else None


def require_prediction(root: Path, card: Card) -> None:
    """Raise DataError where the card needs the list of prediction targets and it is not there."""
    if section_of(card, NuScenesSource).truth == "targets" and prediction_path(root) is None:
        raise DataError(
            f"no file {root / PREDICTION}: {card.id} needs the targets of the prediction challenge, which come with "
            "the map expansion pack of https://www.nuscenes.org/nuscenes#download"
        )


def detection_pattern(card: Card) -> str:
    """The detection files of the card's detector, relative to the root."""
    return f"detections/{section_of(card, NuScenesSource).detector}*.json"


def detection_paths(root: Path, card: Card) -> tuple[Path, ...]:
    """Detection files of the card: the one it names, else all of its detector; none if the detector is simulated.

    Raises DataError where there is none, naming those that are there.
    """
    section = section_of(card, NuScenesSource)
    if card.detector is not None:
        return ()
    if section.detections_file is not None:
        path = Path(section.detections_file).expanduser()
        if not path.is_file():
            raise DataError(f"no file {path}, expected detections in the official submission form")
        return (path,)
    if section.detections_sha256 is not None:
        raise DataError(
            f"{card.id} has the detections of a file with sha256 {section.detections_sha256}: name it with --detections"
        )
    folder = root / "detections"
    if not folder.is_dir():
        raise DataError(f"no folder {folder}{instead_of_stored(card)}; to get them: {DATASET.how_to_get}")
    paths = tuple(sorted(path for path in folder.glob(f"{glob.escape(section.detector)}*.json") if path.is_file()))
    if not paths:
        found = ", ".join(_labelled(path) for path in sorted(folder.glob("*.json"))) or "none"
        raise DataError(f"{folder} has no file {section.detector}*.json; found: {found}{instead_of_stored(card)}")
    return paths


def _labelled(path: Path) -> str:
    """Name of something that may be no file, for messages."""
    if path.is_file():
        return path.name
    return f"{path.name} (a link that leads nowhere)" if path.is_symlink() else f"{path.name} (no file)"
