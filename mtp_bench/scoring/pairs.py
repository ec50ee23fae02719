"""Candidate pairs of ragged rows: every pair of one frame inside a gate.

All frames are paired at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints, in_groups, iou_3d, select

Rows = NDArray[np.intp]
_BLOCK = 1 << 17  # pairs of boxes whose overlap is worked out at once


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs inside the gate, ``E`` of them.

    Rows and columns index two ragged tables sorted by frame.
    """

    row: Rows  # [E] usually the truth
    column: Rows  # [E] usually the tracks
    cost: Floats  # [E] finite, smaller is better

    def __len__(self) -> int:
        return len(self.row)

    def keep(self, mask: Bools | Rows) -> "Pairs":
        """Return the pairs where ``mask`` holds, or those of these numbers in order."""
        return select(self, mask)


def keep_columns(pairs: Pairs, chosen: Rows, columns: int) -> Pairs:
    """Return the pairs of the ``chosen`` among ``columns`` columns.

    Columns are numbered by their place in ``chosen``.
    """
    number = np.full(columns, -1, dtype=np.intp)
    number[chosen] = np.arange(len(chosen))
    pairs = pairs.keep(number[pairs.column] >= 0)
    return Pairs(pairs.row, number[pairs.column], pairs.cost)


def near_pairs(
    frame_a: Ints, xy_a: Floats, frame_b: Ints, xy_b: Floats, reach: float
) -> tuple[Rows, Rows, NDArray[np.float64]]:
    """Return all (a, b, distance) of one frame that are at most ``reach`` apart.

    BEV centre distance in metres, inclusive. ``frame_a`` [A], ``frame_b`` [B]: whole
    numbers; ``xy_a`` [A, 2], ``xy_b`` [B, 2]: m, finite. Pairs are sorted by a. A sweep
    over one sorted key per table, ``frame * span + x``, visits only neighbours in x, so
    the cost grows with the number of pairs that are close in x.
    """
    if len(frame_a) == 0 or len(frame_b) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), np.zeros(0)
    x_a = xy_a[:, 0]
    x_b = xy_b[:, 0]
    min_x = min(float(x_a.min()), float(x_b.min()))
    span = max(float(x_a.max()), float(x_b.max())) - min_x + 2.0 * reach + 1.0
    key_a = frame_a * span + (x_a - min_x)
    key_b = frame_b * span + (x_b - min_x)
    max_key = max(float(np.abs(key_a).max()), float(np.abs(key_b).max()), 1.0)
    # rounding of the keys must not lose a pair
    slack = 8.0 * np.finfo(np.float64).eps * max_key
    order = np.argsort(key_b, kind="stable")
    sorted_b = key_b[order]
    first = np.searchsorted(sorted_b, key_a - (reach + slack), side="left")
    count = np.searchsorted(sorted_b, key_a + (reach + slack), side="right") - first
    # beside each a stand the rows first, first + 1, ... of the sorted b
    a, place = in_groups(count)
    b = order[first[a] + place]
    offset = xy_a[a] - xy_b[b]
    distance = np.sqrt(offset[:, 0] * offset[:, 0] + offset[:, 1] * offset[:, 1])
    # rows of different frames differ by more than the reach in the key
    inside = distance <= reach
    return a[inside], b[inside], distance[inside]


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
    """Return the pairs of boxes of one frame and class inside a gate.

    ``frame_a`` [A], ``box_a`` [A, 7], ``class_a`` [A] and ``frame_b``, ``box_b``,
    ``class_b`` of the two tables. ``measure`` is ``iou_3d`` or ``center_distance``;
    ``threshold`` per class of a: least IoU (the cost is 1 - IoU), or greatest BEV
    distance in metres (docs/definitions, "Events"). A class of -1 in b fits every
    class.
    """
    limit = np.asarray(threshold, dtype=np.float64)
    reach = float(limit.max(initial=0.0))
    if measure == "iou_3d":
        # boxes overlap only if their centres are nearer than the sum of their half
        # diagonals
        reach = _max_radius(box_a) + _max_radius(box_b)
    row, column, distance = near_pairs(
        frame_a, box_a[:, :2], frame_b, box_b[:, :2], reach
    )
    pairs = Pairs(row, column, distance)
    pairs = pairs.keep((class_a[row] == class_b[column]) | (class_b[column] == -1))
    if measure == "iou_3d":
        return _overlapping(pairs, box_a, box_b, limit[class_a])
    return pairs.keep(pairs.cost <= limit[class_a[pairs.row]])


def _max_radius(box: Floats) -> float:
    """Return half the longest diagonal of the boxes."""
    return 0.5 * float(np.hypot(box[:, 4], box[:, 5]).max(initial=0.0))


def _overlapping(pairs: Pairs, box_a: Floats, box_b: Floats, min_iou: Floats) -> Pairs:
    """Return the pairs of boxes with an IoU of ``min_iou`` [A] or more.

    Block by block: an agent that states boxes of 100 m makes every pair a candidate,
    and must not choose the memory.
    """
    rows = [np.zeros(0, dtype=np.intp)]
    columns = [np.zeros(0, dtype=np.intp)]
    costs: list[Floats] = [np.zeros(0)]
    for low in range(0, len(pairs), _BLOCK):
        row = pairs.row[low : low + _BLOCK]
        column = pairs.column[low : low + _BLOCK]
        overlap = iou_3d(box_a[row], box_b[column])
        inside = overlap >= min_iou[row]
        rows.append(row[inside])
        columns.append(column[inside])
        costs.append(1.0 - overlap[inside])
    return Pairs(np.concatenate(rows), np.concatenate(columns), np.concatenate(costs))
