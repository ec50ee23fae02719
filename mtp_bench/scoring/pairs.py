"""Candidate pairs of ragged rows: every pair of one frame inside a gate, over all frames at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints, iou_3d

Rows = NDArray[np.intp]
_BLOCK = 1 << 17  # pairs of boxes whose overlap is worked out at once


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs inside the gate, ``E`` of them; rows and columns index two ragged tables sorted by frame."""

    row: Rows  # [E] usually the truth
    column: Rows  # [E] usually the tracks
    cost: Floats  # [E] finite, smaller is better

    def __len__(self) -> int:
        return len(self.row)

    def keep(self, mask: Bools | Rows) -> "Pairs":
        """The pairs where ``mask`` holds, or those at these places in their order."""
        return Pairs(self.row[mask], self.column[mask], self.cost[mask])


def of_columns(pairs: Pairs, chosen: Rows, columns: int) -> Pairs:
    """The pairs of the ``chosen`` among ``columns`` columns, numbered by their place in ``chosen``."""
    number = np.full(columns, -1, dtype=np.intp)
    number[chosen] = np.arange(len(chosen))
    kept = pairs.keep(number[pairs.column] >= 0)
    return Pairs(kept.row, number[kept.column], kept.cost)


def near_pairs(
    frame_a: Ints, xy_a: Floats, frame_b: Ints, xy_b: Floats, reach: float
) -> tuple[Rows, Rows, NDArray[np.float64]]:
    """All (a, b, distance) of one frame with a BEV centre distance of at most ``reach`` metres (inclusive).

    ``frame_a`` [A], ``frame_b`` [B]: whole numbers; ``xy_a`` [A, 2], ``xy_b`` [B, 2]: m, finite. Pairs are sorted by a.
    A sweep over one sorted key per table, ``frame * span + x``, visits only neighbours in x, so the cost grows with the
    number of pairs that are close in x.
    """
    nothing = np.zeros(0, dtype=np.intp)
    if len(frame_a) == 0 or len(frame_b) == 0:
        return nothing, nothing, np.zeros(0)
    xa, xb = xy_a[:, 0], xy_b[:, 0]
    left = min(float(xa.min()), float(xb.min()))
    span = max(float(xa.max()), float(xb.max())) - left + 2.0 * reach + 1.0
    key_a, key_b = frame_a * span + (xa - left), frame_b * span + (xb - left)
    slack = (
        8.0
        * np.finfo(np.float64).eps
        * max(float(np.abs(key_a).max()), float(np.abs(key_b).max()), 1.0)
    )
    order = np.argsort(key_b, kind="stable")
    sorted_b = key_b[order]
    low = np.searchsorted(sorted_b, key_a - (reach + slack), side="left")
    count = np.searchsorted(sorted_b, key_a + (reach + slack), side="right") - low
    a = np.repeat(np.arange(len(key_a)), count)
    if len(a) == 0:
        return nothing, nothing, np.zeros(0)
    ends = np.cumsum(count)
    b = order[np.arange(len(a)) + np.repeat(low - ends + count, count)]
    gap = xy_a[a] - xy_b[b]
    distance = np.sqrt(gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1])
    close = (
        distance <= reach
    )  # rows of different frames differ by more than this in the key
    return a[close], b[close], distance[close]


def box_pairs(
    frame_a: Ints,
    box_a: Floats,
    class_a: Ints,
    frame_b: Ints,
    box_b: Floats,
    class_b: Ints,
    measure: str,
    threshold: tuple[float, ...],
) -> Pairs:
    """Pairs of boxes of one frame and class inside the event gate (docs/definitions, "Events").

    ``frame_a`` [A], ``box_a`` [A, 7], ``class_a`` [A] and ``frame_b``, ``box_b``, ``class_b`` of the two tables.
    ``measure`` is ``iou_3d`` or ``center_distance``; ``threshold`` per class of a: least IoU (the cost is 1 - IoU), or
    greatest BEV distance in metres. A class of -1 in b fits every class.
    """
    limit = np.asarray(threshold, dtype=np.float64)
    if measure == "iou_3d":
        # boxes overlap only if their centres are nearer than the sum of their half diagonals
        reach = sum(
            0.5 * float(np.hypot(b[:, 4], b[:, 5]).max(initial=0.0))
            for b in (box_a, box_b)
        )
    else:
        reach = float(limit.max(initial=0.0))
    row, column, distance = near_pairs(
        frame_a, box_a[:, :2], frame_b, box_b[:, :2], reach
    )
    fits = (class_a[row] == class_b[column]) | (class_b[column] == -1)
    row, column, distance = row[fits], column[fits], distance[fits]
    if measure == "iou_3d":
        return _overlapping(row, column, box_a, box_b, limit[class_a])
    return Pairs(row, column, distance).keep(distance <= limit[class_a[row]])


def _overlapping(
    row: Rows, column: Rows, box_a: Floats, box_b: Floats, least: Floats
) -> Pairs:
    """The pairs of boxes with an IoU of ``least`` [A] or more.

    Block by block: an agent that states boxes of 100 m makes every pair a candidate, and must not choose the memory.
    """
    kept = []
    for at in range(0, max(len(row), 1), _BLOCK):
        a, b = row[at : at + _BLOCK], column[at : at + _BLOCK]
        overlap = iou_3d(box_a[a], box_b[b])
        kept.append(Pairs(a, b, 1.0 - overlap).keep(overlap >= least[a]))
    return Pairs(
        *(
            np.concatenate([getattr(part, name) for part in kept])
            for name in ("row", "column", "cost")
        )
    )
