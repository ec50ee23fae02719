"""3DMOT2015 in a card and in a folder: the section ``[source]``, and the status of the files of a sequence."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...cards import Card, instead_of_stored
from ...cards.source import SourceSection, Traits
from ..base import section_of
from ..dataset import Dataset, DataStatus
from .files import DETECTIONS, KNOWN, SEQINFO, TRUTH, Rows, read_detections, read_sequence_info, read_truth

DATASET = Dataset.of(__file__)


class Mot3dSource(SourceSection):
    """3DMOT2015: people on the ground plane, seen by a fixed camera, with stored detections."""

    splits = ("train", "val")

    sequence: Literal["PETS09-S2L1", "TUD-Stadtmitte"]
    detector: Literal["acf"] = "acf"  # det/det.txt
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame
    scene_frames: Annotated[int, Field(ge=2)] = 140  # kept frames per scene, the last scene may have fewer
    train_scenes: Annotated[int, Field(ge=0)] = 2  # the first ones are for training, the others are "val"

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(stored_detector=self.detector, places_only=True, bounded_by_truth=True, has_ego=False)


def folder_of(card: Card) -> str:
    """The folder of the card's sequence, relative to the root."""
    return f"train/{section_of(card, Mot3dSource).sequence}"


def needed(card: Card) -> tuple[str, ...]:
    """Files that the card needs of its sequence; a simulated detector needs no detections."""
    return (SEQINFO, TRUTH, DETECTIONS) if card.detector is None else (SEQINFO, TRUTH)


def inspect(card: Card, status: DataStatus) -> None:
    """Note the files that ``card`` needs, and count over them."""
    folder, sequence = folder_of(card), section_of(card, Mot3dSource).sequence
    status.require(*(f"{folder}/{name}" for name in needed(card)))
    status.note_detector(instead_of_stored(card))
    info = status.attempt(read_sequence_info, f"{folder}/{SEQINFO}")
    # Without seqinfo.ini the rows are still counted, against the known length of the sequence.
    length = (info or KNOWN[sequence]).length
    truth = status.attempt(lambda path: read_truth(path, length), f"{folder}/{TRUTH}")
    tracks = len(np.unique(truth.object_id)) if truth else 0
    counts = {"frames": info.length if info else 0, "tracks": tracks, "boxes": _number(truth)}
    if DETECTIONS in needed(card):
        stored = status.attempt(lambda path: read_detections(path, length), f"{folder}/{DETECTIONS}")
        counts["detections"] = _number(stored)
    status.count(counts, status.about.totals[sequence])


def _number(rows: Rows | None) -> int:
    return len(rows.frame) if rows else 0
