"""What of KITTI tracking is there, for ``mtp-bench data``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...cards import Card
from ...errors import DataError
from ...types import Ints
from ..base import DataCheck, DataStatus
from ..roots import candidates
from .files import Labels, read_labels, read_oxts, read_sequence_map
from .layout import FOLDER, HOW_TO_GET, SEQUENCE_MAP, TYPES, VALIDATION, find_root, section_of

Read = TypeVar("Read")

LAYOUT = f"""\
{FOLDER}/
  training/label_02/%04d.txt        labels
  training/calib/%04d.txt           calibration (with ego motion)
  training/oxts/%04d.txt            GPS/IMU (with ego motion)
  detections/<detector>/{{Car,Pedestrian,Cyclist}}/%04d.txt
  {SEQUENCE_MAP}      sequences and frames of the validation split (optional)
  poses_orbslam3/0019.txt           stereo odometry where the GPS is bad (optional)"""
LICENCE = "CC BY-NC-SA 3.0 (Geiger et al.); labels and detections as distributed with AB3DMOT: academic, non-commercial"
CITATION = (
    "A. Geiger, P. Lenz, R. Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite. CVPR 2012"
)
SEQUENCES = tuple(f"{i:04d}" for i in range(21))
# Known totals: all training sequences, then the validation split (boxes and tracks of each type).
TOTALS = {"sequences": 21, "frames": 8008, "tracks": 917, "boxes": 47262}
VALIDATION_FRAMES = 3908
VALIDATION_TOTALS = {"Car": (9550, 190), "Pedestrian": (10124, 142), "Cyclist": (1409, 28)}


def kitti_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs, and counts over the label files beside the known totals."""
    try:
        root = find_root(data)
    except DataError:
        return _status(None, candidates(data, FOLDER)[0])
    problems: list[str] = []
    validation = _validation(root, problems)
    training = tuple(name for name in SEQUENCES if name not in validation)
    names = validation if section_of(card).split == "val" else training
    missing = _missing(root, card, names)
    notes = []
    if not (root / SEQUENCE_MAP).is_file():
        notes.append(f"{SEQUENCE_MAP} is absent: the validation split is taken as {', '.join(VALIDATION)}")
    if card.ego_motion and "0019" in names and not (root / "poses_orbslam3/0019.txt").is_file():
        notes.append("poses_orbslam3/0019.txt is absent: sequence 0019 uses its GPS/IMU unit, which is bad there")
    return _status(root, (root,), missing, tuple(notes), _checks(root, validation, problems), tuple(problems))


def _status(
    root: Path | None, searched: tuple[Path, ...], missing: tuple[str, ...] = (), notes: tuple[str, ...] = (),
    checks: tuple[DataCheck, ...] = (), problems: tuple[str, ...] = (),
) -> DataStatus:  # fmt: skip
    return DataStatus(
        dataset="KITTI tracking", root=root, searched=searched, layout=LAYOUT, missing=missing, notes=notes,
        problems=problems, checks=checks, licence=LICENCE, citation=CITATION, how_to_get=HOW_TO_GET,
    )  # fmt: skip


def _validation(root: Path, problems: list[str]) -> tuple[str, ...]:
    path = root / SEQUENCE_MAP
    return tuple(_attempt(read_sequence_map, path, problems) or VALIDATION) if path.is_file() else VALIDATION


def _missing(root: Path, card: Card, names: tuple[str, ...]) -> tuple[str, ...]:
    """What the card needs and is not there; a folder stands for its files if it has none of them."""
    folders = ["training/label_02"]
    if card.ego_motion:
        folders += ["training/calib", "training/oxts"]
    elif not (root / SEQUENCE_MAP).is_file() or section_of(card).split == "train":
        folders += ["training/oxts"]  # the number of frames
    if card.detector is None:
        stored = f"detections/{section_of(card).detector}"
        folders += [f"{stored}/{TYPES[name][0]}" for name in card.task.classes if name in TYPES]
    missing: list[str] = []
    for folder in folders:
        absent = [f"{folder}/{name}.txt" for name in names if not (root / folder / f"{name}.txt").is_file()]
        missing += [f"{folder}/"] if len(absent) == len(names) else absent
    return tuple(missing)


def _checks(root: Path, validation: tuple[str, ...], problems: list[str]) -> tuple[DataCheck, ...]:
    """Counts over all sequences that are there and over those of the validation split."""
    labels: dict[str, Labels] = {}
    frames: dict[str, int] = {}
    for name in SEQUENCES:
        rows = _attempt(read_labels, root / f"training/label_02/{name}.txt", problems)
        oxts = _attempt(read_oxts, root / f"training/oxts/{name}.txt", problems)
        if rows is not None:
            labels[name] = rows
        if oxts is not None:
            frames[name] = len(oxts.attitude)
    objects = [_count(rows.object_id[rows.type != "DontCare"]) for rows in labels.values()]
    found = (len(labels), sum(frames.values()), sum(n for _, n in objects), sum(n for n, _ in objects))
    checks = [DataCheck(what, n, total) for n, (what, total) in zip(found, TOTALS.items(), strict=True)]
    checks.append(DataCheck("validation frames", sum(frames.get(name, 0) for name in validation), VALIDATION_FRAMES))
    within = [labels[name] for name in validation if name in labels]
    for kind, (boxes, tracks) in VALIDATION_TOTALS.items():
        counts = [_count(rows.object_id[rows.type == kind]) for rows in within]
        checks.append(DataCheck(f"validation {kind} boxes", sum(n for n, _ in counts), boxes))
        checks.append(DataCheck(f"validation {kind} tracks", sum(n for _, n in counts), tracks))
    return tuple(checks)


def _count(object_id: Ints) -> tuple[int, int]:
    """Boxes and tracks."""
    return len(object_id), len(np.unique(object_id))


def _attempt(read: Callable[[Path], Read], path: Path, problems: list[str]) -> Read | None:
    """What ``read`` gives; None if the file is absent, or wrong, which is noted."""
    if not path.is_file():
        return None
    try:
        return read(path)
    except DataError as error:
        problems.append(str(error))
        return None
