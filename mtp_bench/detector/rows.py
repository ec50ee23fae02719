"""Detected boxes of a scene before they are sorted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

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
    columns = [np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(Rows)]
    frame, box, velocity, class_id, score = columns
    order = np.lexsort((box[:, 0], -score, frame))
    start = starts_of(np.bincount(frame, minlength=frames))
    return Detections(start, box[order], velocity[order], class_id[order], score[order])
