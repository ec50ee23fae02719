"""What of nuScenes is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

from ...cards import Card
from ...errors import DataError
from ..base import DataCheck, DataStatus
from ..roots import candidates
from .layout import (
    FOLDER,
    HOW_TO_GET,
    PREDICTION,
    TABLES,
    detection_paths,
    detection_pattern,
    find_root,
    prediction_path,
    section_of,
    versions,
)
from .source import NuScenes, available_splits
from .splits import SPLITS, counted
from .store import TableStore, find_tables
from .work import working

LAYOUT = f"""\
{FOLDER}/
  v1.0-trainval/, v1.0-mini/        a version: the official tables
    {", ".join(f"{name}.json" for name in TABLES[:5])},
    {", ".join(f"{name}.json" for name in TABLES[5:])}
  {PREDICTION}
                                    targets of the prediction challenge, for all versions
  detections/<detector>*.json       detections in the official submission form"""
LICENCE = (
    "CC BY-NC-SA 4.0 and the nuScenes terms of use: non-commercial; "
    "detections as distributed with AB3DMOT: academic, non-commercial"
)
CITATION = (
    "H. Caesar et al.: nuScenes: A multimodal dataset for autonomous driving. CVPR 2020; Megvii detections: "
    "B. Zhu et al.: Class-balanced grouping and sampling for point cloud 3D object detection. arXiv 2019; CenterPoint: "
    "T. Yin et al.: Center-based 3D object detection and tracking. CVPR 2021"
)
# Known totals. Boxes of v1.0-mini are not counted: copies without animals and debris are as good for our tasks.
TOTALS = {
    "v1.0-mini": {"scenes": 10, "keyframes": 404},
    "v1.0-trainval": {"scenes": 850, "keyframes": 34149, "instances": 64386, "boxes": 1166187},
}
TARGETS = {
    "v1.0-mini": {"mini_train": 742, "mini_val": 61},
    "v1.0-trainval": {"train": 32186, "train_val": 8560, "val": 9041},
}


def nuscenes_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs, and counts over the tables beside the known totals.

    Makes the compact copy of the tables and detections, if they are whole and it is not there.
    """
    try:
        root = find_root(data)
    except DataError:
        return _status(None, candidates(data, FOLDER)[0])
    section = section_of(card)
    missing = _missing(root, card)
    if f"{section.version}/" in missing or any(f"{section.version}/{name}.json" in missing for name in TABLES):
        return _status(root, (root,), missing, (f"versions found: {', '.join(versions(root))}",))
    try:
        tables = find_tables(root, section.version)
        with working(tables.bytes_left, None, None) as work:
            store = tables.open(work)
    except DataError as error:
        return _status(root, (root,), missing, problems=(str(error),))
    splits = available_splits(store, section.truth == "targets" and prediction_path(root) is not None)
    notes = [f"{section.version} has the splits {counted(splits)}"] if splits else []
    if splits and section.split not in splits:
        missing = (*missing, f"scenes of split {section.split!r} in {section.version}/")
    paths, _ = _detections(root, card)
    if paths:
        notes.append(f"detections: {', '.join(path.name for path in paths)}")
    problems = () if missing else _problems(card, data)
    return _status(root, (root,), missing, tuple(notes), problems, _checks(store))


def _status(
    root: Path | None, searched: tuple[Path, ...], missing: tuple[str, ...] = (), notes: tuple[str, ...] = (),
    problems: tuple[str, ...] = (), checks: tuple[DataCheck, ...] = (),
) -> DataStatus:  # fmt: skip
    return DataStatus(
        dataset="nuScenes", root=root, searched=searched, layout=LAYOUT, missing=missing, notes=notes,
        problems=problems, checks=checks, licence=LICENCE, citation=CITATION, how_to_get=HOW_TO_GET,
    )  # fmt: skip


def _missing(root: Path, card: Card) -> tuple[str, ...]:
    """What the card needs and is not there; a folder stands for its files if it has none of them."""
    section = section_of(card)
    missing = [f"{section.version}/{name}.json" for name in TABLES]
    missing = [name for name in missing if not (root / name).is_file()]
    if len(missing) == len(TABLES):
        missing = [f"{section.version}/"]
    if section.truth == "targets" and prediction_path(root) is None:
        missing.append(PREDICTION)
    _, lost = _detections(root, card)
    return (*missing, *lost)


def _detections(root: Path, card: Card) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Detection files of the card, and what is missing if there is none."""
    section = section_of(card)
    try:
        return detection_paths(root, card), ()
    except DataError as error:
        named = section.detections_file is not None or section.detections_sha256 is not None
        return (), (str(error) if named else detection_pattern(card),)


def _problems(card: Card, data: str | Path | None) -> tuple[str, ...]:
    """What stops the card's scenes from being read."""
    try:
        NuScenes(card, data)
    except DataError as error:
        return (str(error),)
    return ()


def _checks(store: TableStore) -> tuple[DataCheck, ...]:
    """Counts over the tables, whatever the card's split."""
    version, scenes = store.tables.version, store.index["scenes"]
    found = {
        "scenes": len(scenes),
        "keyframes": sum(counts["frames"] for counts in scenes.values()),
        "instances": store.index["instances"],
        "boxes": store.index["boxes"],
    }
    checks = [DataCheck(what, found[what], total) for what, total in TOTALS.get(version, {}).items()]
    if store.tables.prediction is None:
        return tuple(checks)
    splits = available_splits(store, targets=True)
    for split in SPLITS:
        if (total := TARGETS.get(version, {}).get(split)) is not None:
            targets = sum(scenes[name]["targets"] for name in splits.get(split, ()))
            checks.append(DataCheck(f"prediction targets of {split}", targets, total))
    return tuple(checks)
