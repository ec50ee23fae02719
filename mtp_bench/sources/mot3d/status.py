"""What of 3DMOT2015 is there, for ``mtp-bench data``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...cards import Card, instead_of_stored
from ..base import section_of
from ..dataset import Dataset, DataStatus
from .files import DATASET, DETECTIONS, KNOWN, SEQINFO, TRUTH, Rows, read_detections, read_sequence_info, read_truth
from .section import Mot3dSource
from .source import needed

RECORDINGS = {
    "PETS09-S2L1": "J. Ferryman, A. Shahrokni: PETS2009: dataset and challenge. PETS-Winter 2009",
    "TUD-Stadtmitte": "M. Andriluka, S. Roth, B. Schiele: Monocular 3D pose estimation and tracking by detection. "
    "CVPR 2010",
}
TOTALS = {
    "PETS09-S2L1": {"frames": 795, "tracks": 19, "boxes": 4650, "detections": 5578},
    "TUD-Stadtmitte": {"frames": 179, "tracks": 10, "boxes": 1156, "detections": 1129},
}


def mot3d_status(card: Card, data: str | Path | None) -> DataStatus:
    """Files that ``card`` needs of its sequence, and counts over them beside the known totals."""
    sequence = section_of(card, Mot3dSource).sequence
    folder = f"train/{sequence}"

    def inspect(found: DataStatus) -> None:
        found.require(*(f"{folder}/{name}" for name in needed(card)))
        found.note_detector(instead_of_stored(card))
        _count(found, folder, dict(TOTALS[sequence]), stored=card.detector is None)

    return about_mot3d(card).status(data, folder, inspect)


def about_mot3d(card: Card) -> Dataset:
    """What is known of the sequence of ``card``."""
    sequence = section_of(card, Mot3dSource).sequence
    cited = f"{DATASET.citation}; {RECORDINGS[sequence]}"
    return replace(DATASET, name=f"{DATASET.name} {sequence}", citation=cited)


def _count(found: DataStatus, folder: str, totals: dict[str, int], stored: bool) -> None:
    """Counts of the sequence; what the card does not need is not read."""
    info = found.attempt(read_sequence_info, f"{folder}/{SEQINFO}")
    # Without seqinfo.ini the rows are still counted, against the length that the sequence is known to have.
    length = (info or KNOWN[Path(folder).name]).length
    truth = found.attempt(lambda path: read_truth(path, length), f"{folder}/{TRUTH}")
    counts = [info.length if info else 0, len(np.unique(truth.object_id)) if truth else 0, _number(truth)]
    if stored:
        counts.append(_number(found.attempt(lambda path: read_detections(path, length), f"{folder}/{DETECTIONS}")))
    else:
        del totals["detections"]
    found.count(totals, counts)


def _number(rows: Rows | None) -> int:
    return len(rows.frame) if rows else 0
