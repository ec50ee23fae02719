"""Files of nuScenes that a card needs, and counts over the tables, for ``mtp-bench data``."""

from __future__ import annotations

from ...cards import Card, instead_of_stored
from ...errors import DataError
from ..base import section_of
from ..dataset import DataStatus
from .layout import (
    CAMERAS,
    EXPANSION,
    PREDICTION,
    TABLES,
    NuScenesSource,
    detection_paths,
    detection_pattern,
    versions,
)
from .names import SPLITS, counted, split_scenes
from .source import NuScenes, available_splits
from .store import TableStore, open_tables

DOWNLOADS = "https://www.nuscenes.org/nuscenes#download"
WITH = {  # notes on files that only pictures show
    f"{EXPANSION}/*.json": "pictures show the road of",
    CAMERAS: "pictures of events show the images of",
}
WITHOUT = {
    f"{EXPANSION}/*.json": f"{EXPANSION}/ is missing, so pictures show no road: it is in the map expansion pack (v1.3) "
    f"of {DOWNLOADS}, to be unpacked into maps/",
    CAMERAS: f"{CAMERAS}/ is missing, so pictures of events show no image: images are in the file blobs of "
    f"{DOWNLOADS} (keyframes are enough), to be unpacked here",
}


def inspect(card: Card, status: DataStatus) -> None:
    """Note the files that ``card`` needs, and count over the tables.

    Makes the compact copy of the tables and detections, if the files are complete and it is missing.
    """
    section = section_of(card, NuScenesSource)
    status.require_all(section.version, [f"{name}.json" for name in TABLES])
    complete = not status.missing
    detections = _require(status, card)
    if not complete:
        status.notes.append(f"versions found: {', '.join(versions(status.folder))}")
        return
    try:
        tables = open_tables(status.folder, section.version)
        _require_split(status, card, tables)
        if detections:
            status.notes.append(f"detections: {', '.join(detections)}")
        _note_pictures(status)
        _count(status, tables)
        if not status.missing:
            NuScenes(card, status.folder)  # raises what stops the card's scenes from being read
    except DataError as error:
        status.add_problem(error)


def _require(status: DataStatus, card: Card) -> list[str]:
    """Note which files the card needs beside the tables and are missing; names of its detection files."""
    section = section_of(card, NuScenesSource)
    if section.truth == "targets":
        status.require(PREDICTION)
    try:
        return [path.name for path in detection_paths(status.folder, card)]
    except DataError as error:
        own = section.detections_file is not None or section.detections_sha256 is not None
        status.missing.append(str(error) if own else detection_pattern(card))
        status.note_detector(instead_of_stored(card))
        return []


def _require_split(status: DataStatus, card: Card, tables: TableStore) -> None:
    """Note the splits that the tables have; that of the card is missing if it has no scenes."""
    section = section_of(card, NuScenesSource)
    splits = available_splits(tables, section.truth == "targets" and tables.targets is not None)
    if not splits:
        return
    status.notes.append(f"{section.version} has the splits {counted(splits)}")
    if section.split not in splits:
        status.missing.append(f"scenes of split {section.split!r} in {section.version}/")


def _note_pictures(status: DataStatus) -> None:
    for pattern, note in WITH.items():
        names = sorted(path.stem for path in status.folder.glob(pattern))
        status.notes.append(f"{note} {', '.join(names)}" if names else WITHOUT[pattern])


def _count(status: DataStatus, tables: TableStore) -> None:
    """Counts over the tables of all splits."""
    counts = {
        "scenes": len(tables.scenes), "keyframes": int(tables.start[-1]), "instances": tables.instances,
        "boxes": tables.boxes,
    }  # fmt: skip
    if tables.targets is not None:
        targets = dict(zip(tables.scenes, tables.targets.tolist(), strict=True))
        for split in SPLITS:
            counts[f"prediction targets of {split}"] = sum(targets[name] for name in split_scenes(split, targets))
    status.count(counts, status.about.totals.get(tables.version, {}))
