"""What of nuScenes is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

from ...cards import Card, instead_of_stored
from ...errors import DataError
from ..base import section_of
from ..dataset import DataCheck, DataStatus
from .layout import (
    CAMERAS,
    DATASET,
    EXPANSION,
    PREDICTION,
    TABLES,
    VERSIONS,
    detection_paths,
    detection_pattern,
    prediction_path,
    versions,
)
from .section import NuScenesSource
from .source import NuScenes, available_splits
from .splits import SPLITS, counted
from .store import TableStore, find_tables
from .work import working

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

    def inspect(found: DataStatus) -> None:
        version = section_of(card, NuScenesSource).version
        found.require_all(version, [f"{name}.json" for name in TABLES])
        whole = not found.missing
        detections = _require(found, card)
        if not whole:
            found.notes.append(f"versions found: {', '.join(versions(found.folder))}")
            return
        try:
            tables = find_tables(found.folder, version)
            with working(tables.bytes_left, None, None) as work:
                store = tables.open(work)
        except DataError as error:
            found.add_problem(error)
            return
        _look_into(found, card, store)
        if detections:
            found.notes.append(f"detections: {', '.join(path.name for path in detections)}")
        _note_pictures(found)
        if not found.missing:
            try:
                NuScenes(card, data)
            except DataError as error:  # stops the card's scenes from being read
                found.add_problem(error)
        _count(found, store)

    return DATASET.status(data, VERSIONS, inspect)


def _require(found: DataStatus, card: Card) -> tuple[Path, ...]:
    """Note what the card needs beside the tables and is not there; its detection files."""
    section = section_of(card, NuScenesSource)
    if section.truth == "targets":
        found.require(PREDICTION)
    try:
        return detection_paths(found.folder, card)
    except DataError as error:
        named = section.detections_file is not None or section.detections_sha256 is not None
        found.missing.append(str(error) if named else detection_pattern(card))
        found.note_detector(instead_of_stored(card))
        return ()


def _note_pictures(found: DataStatus) -> None:
    """Note what only pictures show, and where to get it."""
    maps = sorted(path.stem for path in (found.folder / EXPANSION).glob("*.json"))
    if maps:
        found.notes.append(f"pictures show the road of {', '.join(maps)}")
    else:
        found.notes.append(
            f"{EXPANSION}/ is missing, so pictures show no road: it is in the map expansion pack (v1.3) of "
            "https://www.nuscenes.org/nuscenes#download, to be unpacked into maps/"
        )
    cameras = sorted(path.name for path in found.folder.glob(CAMERAS))
    if cameras:
        found.notes.append(f"pictures of events show the images of {', '.join(cameras)}")
    else:
        found.notes.append(
            f"{CAMERAS}/ is missing, so pictures of events show no image: images are in the file blobs of "
            "https://www.nuscenes.org/nuscenes#download (keyframes are enough), to be unpacked here"
        )


def _look_into(found: DataStatus, card: Card, store: TableStore) -> None:
    """Note the splits that the tables have; that of the card is missing if it has no scenes."""
    section = section_of(card, NuScenesSource)
    splits = available_splits(store, section.truth == "targets" and prediction_path(found.folder) is not None)
    if not splits:
        return
    found.notes.append(f"{section.version} has the splits {counted(splits)}")
    if section.split not in splits:
        found.missing.append(f"scenes of split {section.split!r} in {section.version}/")


def _count(found: DataStatus, store: TableStore) -> None:
    """Counts over the tables, whatever the card's split."""
    version, scenes = store.tables.version, store.index["scenes"]
    numbers = {
        "scenes": len(scenes),
        "keyframes": sum(counts["frames"] for counts in scenes.values()),
        "instances": store.index["instances"],
        "boxes": store.index["boxes"],
    }
    totals = TOTALS.get(version, {})
    found.count(totals, [numbers[what] for what in totals])
    if store.tables.prediction is None:
        return
    splits = available_splits(store, targets=True)
    for split in SPLITS:
        if (total := TARGETS.get(version, {}).get(split)) is not None:
            targets = sum(scenes[name]["targets"] for name in splits.get(split, ()))
            found.checks.append(DataCheck(f"prediction targets of {split}", targets, total))
