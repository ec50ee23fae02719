"""Detected boxes of a scene before they are sorted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Detections, Floats, Ints, joined, starts_of


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
    rows = joined(parts)
    order = np.lexsort((rows.box[:, 0], -rows.score, rows.frame))
    start = starts_of(np.bincount(rows.frame, minlength=frames))
    return Detections(start, rows.box[order], rows.velocity[order], rows.class_id[order], rows.score[order])
