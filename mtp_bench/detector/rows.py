"""Detected boxes before they are put in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Detections, Floats, Ints, starts_of


@dataclass(frozen=True, eq=False)
class Rows:
    """Detected boxes of a scene, in any order."""

    frame: Ints  # [R]
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where not measured
    class_id: Ints  # [R]
    score: Floats  # [R]

    @classmethod
    def none(cls) -> Rows:
        """No rows."""
        no_ints = np.zeros(0, dtype=np.int64)
        return cls(no_ints, np.zeros((0, 7)), np.zeros((0, 2)), no_ints, np.zeros(0))


def in_order(parts: Sequence[Rows], frames: int) -> Detections:
    """All parts by frame; within a frame by descending score, then by x: the order does not tell what a row is."""
    frame = np.concatenate([part.frame for part in parts])
    box = np.concatenate([part.box for part in parts])
    velocity = np.concatenate([part.velocity for part in parts])
    class_id = np.concatenate([part.class_id for part in parts])
    score = np.concatenate([part.score for part in parts])
    order = np.lexsort((box[:, 0], -score, frame))
    start = starts_of(np.bincount(frame, minlength=frames))
    return Detections(start, box[order], velocity[order], class_id[order], score[order])
