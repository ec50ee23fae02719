"""Facts about 3DMOT2015, and the status of the files of a sequence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...cards import Card, instead_of_stored
from ..base import section_of
from ..dataset import Dataset, DataStatus
from .files import DETECTIONS, KNOWN, SEQINFO, TRUTH, Rows, read_detections, read_sequence_info, read_truth
from .section import Mot3dSource

DATASET = Dataset(
    name="3DMOT2015",
    folders=("mot3d2015", "3DMOT2015"),  # the second is the folder of the official archive
    layout="""\
mot3d2015/ (or 3DMOT2015/)
  train/<sequence>/gt/gt.txt        true positions
  train/<sequence>/det/det.txt      ACF detections (not needed with a simulated detector)
  train/<sequence>/seqinfo.ini      frame rate and number of frames""",
    licence="CC BY-NC-SA 3.0 (MOTChallenge): non-commercial",
    citation=(
        "L. Leal-Taixé, A. Milan, I. Reid, S. Roth, K. Schindler: MOTChallenge 2015: towards a benchmark for "
        "multi-target tracking. arXiv 1504.01942, 2015"
    ),
    how_to_get=(
        "download 3D MOT 2015 from https://motchallenge.net/data/3D_MOT_2015 and unpack it into mot3d2015/ or "
        "3DMOT2015/ of the data root; the images are not needed"
    ),
)
RECORDINGS = {
    "PETS09-S2L1": "J. Ferryman, A. Shahrokni: PETS2009: dataset and challenge. PETS-Winter 2009",
    "TUD-Stadtmitte": "M. Andriluka, S. Roth, B. Schiele: Monocular 3D pose estimation and tracking by detection. "
    "CVPR 2010",
}
TOTALS = {
    "PETS09-S2L1": {"frames": 795, "tracks": 19, "boxes": 4650, "detections": 5578},
    "TUD-Stadtmitte": {"frames": 179, "tracks": 10, "boxes": 1156, "detections": 1129},
}


def about(card: Card) -> Dataset:
    """Facts about the sequence of ``card``."""
    sequence = section_of(card, Mot3dSource).sequence
    cited = f"{DATASET.citation}; {RECORDINGS[sequence]}"
    return replace(DATASET, name=f"{DATASET.name} {sequence}", citation=cited)


def folder_of(card: Card) -> str:
    """The folder of the card's sequence, relative to the root."""
    return f"train/{section_of(card, Mot3dSource).sequence}"


def needed(card: Card) -> tuple[str, ...]:
    """Files that the card needs of its sequence; a simulated detector needs no detections."""
    return (SEQINFO, TRUTH, DETECTIONS) if card.detector is None else (SEQINFO, TRUTH)


def inspect(card: Card, found: DataStatus) -> None:
    """Note the files that ``card`` needs, and count over them."""
    folder, totals = folder_of(card), dict(TOTALS[section_of(card, Mot3dSource).sequence])
    found.require(*(f"{folder}/{name}" for name in needed(card)))
    found.note_detector(instead_of_stored(card))
    info = found.attempt(read_sequence_info, f"{folder}/{SEQINFO}")
    # Without seqinfo.ini the rows are still counted, against the known length of the sequence.
    length = (info or KNOWN[Path(folder).name]).length
    truth = found.attempt(lambda path: read_truth(path, length), f"{folder}/{TRUTH}")
    counts = [info.length if info else 0, len(np.unique(truth.object_id)) if truth else 0, _number(truth)]
    if DETECTIONS in needed(card):
        counts.append(_number(found.attempt(lambda path: read_detections(path, length), f"{folder}/{DETECTIONS}")))
    else:
        del totals["detections"]
    found.count(totals, counts)


def _number(rows: Rows | None) -> int:
    return len(rows.frame) if rows else 0
