"""What of 3DMOT2015 is there, for ``mtp-bench data``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...cards import Card
from ...errors import DataError
from ..base import DataCheck, DataStatus
from .files import (
    DETECTIONS,
    FOLDERS,
    HOW_TO_GET,
    KNOWN,
    SEQINFO,
    TRUTH,
    Rows,
    SequenceInfo,
    find_root,
    read_detections,
    read_sequence_info,
    read_truth,
    searched,
)
from .source import needed, section_of

Read = TypeVar("Read", SequenceInfo, Rows)

LAYOUT = f"""\
{FOLDERS[0]}/ (or {FOLDERS[1]}/)
  train/<sequence>/gt/gt.txt        true positions
  train/<sequence>/det/det.txt      ACF detections (not needed with a simulated detector)
  train/<sequence>/seqinfo.ini      frame rate and number of frames"""
LICENCE = "CC BY-NC-SA 3.0 (MOTChallenge): non-commercial"
BENCHMARK = (
    "L. Leal-Taixé, A. Milan, I. Reid, S. Roth, K. Schindler: MOTChallenge 2015: towards a benchmark for multi-target "
    "tracking. arXiv 1504.01942, 2015"
)
RECORDINGS = {
    "PETS09-S2L1": "J. Ferryman, A. Shahrokni: PETS2009: dataset and challenge. PETS-Winter 2009",
    "TUD-Stadtmitte": "M. Andriluka, S. Roth, B. Schiele: Monocular 3D pose estimation and tracking by detection. "
    "CVPR 2010",
}
TOTALS = {"PETS09-S2L1": (795, 19, 4650, 5578), "TUD-Stadtmitte": (179, 10, 1156, 1129)}
COUNTED = ("frames", "tracks", "boxes", "detections")


def mot3d_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs of its sequence, and counts over them beside the known totals."""
    sequence = section_of(card).sequence
    try:
        root = find_root(data, sequence)
    except DataError:
        return _status(sequence, None, searched(data)[0])
    folder = root / "train" / sequence
    missing = tuple(f"train/{sequence}/{name}" for name in needed(card) if not (folder / name).is_file())
    problems: list[str] = []
    checks = _checks(folder, card, problems)
    return _status(sequence, root, (root,), missing, checks, tuple(problems))


def _status(
    sequence: str, root: Path | None, looked_at: tuple[Path, ...], missing: tuple[str, ...] = (),
    checks: tuple[DataCheck, ...] = (), problems: tuple[str, ...] = (),
) -> DataStatus:  # fmt: skip
    return DataStatus(
        dataset=f"3DMOT2015 {sequence}", root=root, searched=looked_at, layout=LAYOUT, missing=missing, notes=(),
        problems=problems, checks=checks, licence=LICENCE, citation=f"{BENCHMARK}; {RECORDINGS[sequence]}",
        how_to_get=HOW_TO_GET,
    )  # fmt: skip


def _checks(folder: Path, card: Card, problems: list[str]) -> tuple[DataCheck, ...]:
    """Counts of the sequence; what the card does not need is not read."""
    info = _attempt(read_sequence_info, folder / SEQINFO, problems)
    # Without seqinfo.ini the rows are still counted, against the length that the sequence is known to have.
    length = (info or KNOWN[folder.name]).length
    truth = _attempt(lambda path: read_truth(path, length), folder / TRUTH, problems)
    found = [info.length if info else 0, len(np.unique(truth.object_id)) if truth else 0, _rows(truth)]
    if card.detector is None:
        found.append(_rows(_attempt(lambda path: read_detections(path, length), folder / DETECTIONS, problems)))
    totals = TOTALS[folder.name][: len(found)]
    return tuple(DataCheck(*count) for count in zip(COUNTED[: len(found)], found, totals, strict=True))


def _rows(rows: Rows | None) -> int:
    return len(rows.frame) if rows else 0


def _attempt(read: Callable[[Path], Read], path: Path, problems: list[str]) -> Read | None:
    """What ``read`` gives; None if the file is absent, or wrong, which is noted."""
    if not path.is_file():
        return None
    try:
        return read(path)
    except DataError as error:
        problems.append(str(error))
        return None
