"""What of WILDTRACK is there, for ``mtp-bench data``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Ints
from ..base import DataCheck, DataStatus
from .files import read_annotations, read_cameras, read_detections
from .source import (
    ANNOTATIONS,
    DETECTIONS,
    FOLDERS,
    FRAMES,
    HOW_TO_GET,
    SCENE_FRAMES,
    SCENES,
    SPLITS,
    STEP,
    find_root,
    needs_detections,
    searched,
    section_of,
)

LAYOUT = f"""\
{FOLDERS[0]}/                         or {FOLDERS[1]}/, as in the archive
  {ANNOTATIONS}/%08d.json    frames 0, 5, ..., {STEP * (FRAMES - 1)}
  {DETECTIONS}       MVDet on the last {SCENE_FRAMES} frames: frame gx gy
  calibrations/extrinsic/*.xml          cameras, for drawing (optional)
  calibrations/intrinsic_zero/*.xml     (optional)"""
LICENCE = "WILDTRACK and MVDet's detections: none stated; research only"
CITATION = (
    "T. Chavdarova et al.: WILDTRACK: a multi-camera HD dataset for dense unscripted pedestrian detection. CVPR 2018; "
    "detections: Y. Hou, L. Zheng, S. Gould: Multiview detection with feature perspective transformation (MVDet). "
    "ECCV 2020"
)
TOTALS = {"frames": FRAMES, "annotations": 9518, "people": 313, "detections": 966}


def wildtrack_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs, and counts over all files beside the known totals."""
    section_of(card)
    try:
        root = find_root(data)
    except DataError:
        return _status(None, searched(data)[0])
    problems: list[str] = []
    checks = _checks(root, problems)
    return _status(root, (root,), _missing(root, card), _notes(root, card, problems), checks, tuple(problems))


def _status(
    root: Path | None, searched: tuple[Path, ...], missing: tuple[str, ...] = (), notes: tuple[str, ...] = (),
    checks: tuple[DataCheck, ...] = (), problems: tuple[str, ...] = (),
) -> DataStatus:  # fmt: skip
    return DataStatus(
        dataset="WILDTRACK", root=root, searched=searched, layout=LAYOUT, missing=missing, notes=notes,
        problems=problems, checks=checks, licence=LICENCE, citation=CITATION, how_to_get=HOW_TO_GET,
    )  # fmt: skip


def _missing(root: Path, card: Card) -> tuple[str, ...]:
    """What the card needs and is not there; the folder stands for the annotations if it has none of the split."""
    names = [
        f"{ANNOTATIONS}/{SCENES[scene] + STEP * t:08d}.json"
        for scene in SPLITS[section_of(card).split]
        for t in range(SCENE_FRAMES)
    ]
    absent = [name for name in names if not (root / name).is_file()]
    missing = [f"{ANNOTATIONS}/"] if len(absent) == len(names) else absent
    if needs_detections(card) and not (root / DETECTIONS).is_file():
        missing.append(DETECTIONS)
    return tuple(missing)


def _notes(root: Path, card: Card, problems: list[str]) -> tuple[str, ...]:
    """What is special about the detections, and whether the cameras can be drawn; broken ones are a problem."""
    notes = []
    if section_of(card).detector is not None:
        notes.append(f"detections only for the last {SCENE_FRAMES} frames; the other frames have simulated ones")
    if not (root / "calibrations").is_dir():
        notes.append("calibrations/ is absent: scenes can be read, pixels cannot be computed")
        return tuple(notes)
    try:
        read_cameras(root)
    except DataError as error:
        problems.append(str(error))
    return tuple(notes)


def _checks(root: Path, problems: list[str]) -> tuple[DataCheck, ...]:
    frames = 0
    people: list[Ints] = [np.zeros(0, dtype=np.int64)]
    for path in sorted((root / ANNOTATIONS).glob("*.json")):
        frames += 1
        try:
            people.append(read_annotations(path).person)
        except DataError as error:
            problems.append(str(error))
    everyone = np.concatenate(people)
    detections = 0
    try:
        detections = len(read_detections(root / DETECTIONS).frame) if (root / DETECTIONS).is_file() else 0
    except DataError as error:
        problems.append(str(error))
    found = (frames, len(everyone), len(np.unique(everyone)), detections)
    return tuple(DataCheck(what, n, total) for n, (what, total) in zip(found, TOTALS.items(), strict=True))
