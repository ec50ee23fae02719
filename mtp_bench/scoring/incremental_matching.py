"""Incremental matching: forecasts are added one by one, and a cut keeps those added so far.

Added by falling confidence, they give the matchings of all cuts in one pass: each addition changes one path.
"""

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ..core import Floats, Ints
from .matching import Matched
from .pairs import Pairs, Rows

NEVER = np.iinfo(np.intp).max  # the step of a column that is not added
_MICRO = (
    1e6  # costs are integers in micrometres, so that the order of a sum does not matter
)
_TIE_BITS = 40
_UNMATCHED = 1 << 120  # outweighs every sum of costs


@dataclass(frozen=True, eq=False)
class Additions:
    """Changes of a growing matching: at ``step`` [E], ascending, ``row`` [E] is matched to ``column`` [E] from then on.

    A matched row stays matched, possibly to other columns; a column that becomes unmatched stays unmatched.
    """

    step: Rows
    row: Rows
    column: Rows
    dropped: Rows  # [columns] the step from which each column is unmatched, NEVER where it stays matched


def add_in_order(
    pairs: Pairs, step: Rows, confidence: Floats, tie: Floats
) -> Additions:
    """Extend the matching by each column at its ``step`` [columns].

    It has maximum cardinality, then the surest columns, then least cost, then the larger ``tie`` [E] of the pairs, m.
    Columns of equal ``confidence`` [columns] are one group, in which cost decides. Steps are distinct and come by
    falling confidence, so a matched column gives way to one of its own group alone; a column with step NEVER is not
    added. Costs are rounded to micrometres.
    """
    if not len(pairs):
        nothing = np.zeros(0, dtype=np.intp)
        return Additions(nothing, nothing, nothing, step)
    come = step[pairs.column] != NEVER
    pairs, tie = pairs.keep(come), tie[come]
    of_row, of_column = (
        np.bincount(pairs.row),
        np.bincount(pairs.column, minlength=len(step)),
    )
    dropped = np.where(of_column > 0, NEVER, step)
    alone = (of_row[pairs.row] == 1) & (of_column[pairs.column] == 1)
    single, contested = pairs.keep(alone), pairs.keep(~alone)
    changes: list[tuple[int, int, int]] = []
    if len(contested):
        cost = _whole_costs(contested.cost, tie[~alone])
        # only the order matters: matched sets form a matroid, so any falling weights choose the same columns
        group = np.unique(confidence, return_inverse=True)[1]
        _grow(contested, cost, step, group, changes, dropped)
    grown = np.array(changes, dtype=np.intp).reshape(-1, 3)
    at = np.concatenate([step[single.column], grown[:, 0]])
    order = np.argsort(at, kind="stable")
    row, column = (
        np.concatenate([single.row, grown[:, 1]]),
        np.concatenate([single.column, grown[:, 2]]),
    )
    return Additions(at[order], row[order], column[order], dropped)


def final_match(additions: Additions, rows: int) -> Matched:
    """Column matched to each row [rows] with all columns added, -1 for none."""
    matched = np.full(rows, -1, dtype=np.intp)
    last = last_of(additions.row)
    matched[additions.row[last]] = additions.column[last]
    return matched


def last_of(values: Ints) -> NDArray[np.intp]:
    """Index of the last occurrence of each distinct value."""
    return len(values) - 1 - np.unique(values[::-1], return_index=True)[1]


def _whole_costs(cost: Floats, tie: Floats) -> list[int]:
    """One integer per pair that orders by cost, then tie; sums are exact.

    The two are packed into bits of one integer: exact for components of up to about 1 000 matched pairs, beyond which
    a sum of ties may carry over into the bits above.
    """
    main = np.rint(cost * _MICRO).astype(np.int64).tolist()
    far = (
        np.rint(np.minimum(np.where(np.isfinite(tie), tie, 1e3), 1e3) * _MICRO)
        .astype(np.int64)
        .tolist()
    )
    return [(m << _TIE_BITS) - f for m, f in zip(main, far, strict=True)]


def _grow(
    pairs: Pairs,
    cost: list[int],
    step: Rows,
    group: Ints,
    changes: list[tuple[int, int, int]],
    dropped: Rows,
) -> None:
    """Add the columns by their ``step``: append (step, row, column) to ``changes`` and fill in ``dropped``.

    The Hungarian method with one shortest path per column (Jonker and Volgenant 1987). Every column may also stay
    unmatched, at a cost above all others and the higher the surer it is. ``group`` [columns]: number of the confidence
    among all, the surest last. Paths stay inside the connected components of the pairs.
    """
    edges: dict[int, list[tuple[int, int]]] = {}
    part = np.argsort(step[pairs.column], kind="stable")
    for place, row, column in zip(
        part.tolist(),
        pairs.row[part].tolist(),
        pairs.column[part].tolist(),
        strict=True,
    ):
        edges.setdefault(column, []).append((row, cost[place]))
    state = _Matching(
        edges, {column: _UNMATCHED * (1 + int(group[column])) for column in edges}
    )
    for column in edges:
        path, left_out = state.add(column)
        changes += [(int(step[column]), row, taker) for row, taker in path]
        if left_out >= 0:
            dropped[left_out] = step[column]


class _Matching:
    """The optimal matching of the columns added so far, with the dual potentials."""

    def __init__(
        self, edges: dict[int, list[tuple[int, int]]], unmatched: dict[int, int]
    ) -> None:
        self._edges = edges  # column -> rows inside the gate and their costs
        self._unmatched = unmatched  # column -> cost of leaving it out
        self._row_of: dict[int, int] = {}
        self._column_of: dict[int, int] = {}
        self._of_column: dict[int, int] = {}  # potentials
        self._of_row = {row: 0 for near in edges.values() for row, _ in near}

    def add(self, new: int) -> tuple[list[tuple[int, int]], int]:
        """Changed rows with their new columns, and the column that becomes unmatched, -1 for none."""
        self._of_column[new] = min(
            cost - self._of_row[row] for row, cost in self._edges[new]
        )
        done, before, end, left_out, total = self._shortest_path(new)
        self._of_column[new] += total
        for row, distance in done.items():
            if row in self._column_of:
                self._of_column[self._column_of[row]] += total - distance
                self._of_row[row] -= total - distance
        if end < 0 and left_out != new:
            end = self._row_of.pop(left_out)
        path = []
        while end >= 0:
            taker = before[end]
            earlier = self._row_of.get(taker, -1)
            self._row_of[taker], self._column_of[end] = end, taker
            path.append((end, taker))
            end = earlier
        return path, left_out

    def _shortest_path(
        self, new: int
    ) -> tuple[dict[int, int], dict[int, int], int, int, int]:
        """Distances and preceding columns of reached rows, the free row or -1, the unmatched column, the cost."""
        distance: dict[int, int] = {}
        before: dict[int, int] = {}
        done: dict[int, int] = {}
        waiting: list[
            tuple[int, int]
        ] = []  # a heap of distances and rows; a row may be in it twice
        column, base, left_out, least = (
            new,
            0,
            new,
            self._unmatched[new] - self._of_column[new],
        )
        while True:
            for row, cost in self._edges[column]:
                far = base + cost - self._of_column[column] - self._of_row[row]
                if row not in done and far < distance.get(row, far + 1) and far < least:
                    distance[row], before[row] = far, column
                    heappush(waiting, (far, row))
            while waiting and waiting[0][1] in done:
                heappop(waiting)
            if not waiting or waiting[0][0] >= least:
                return done, before, -1, left_out, least
            base, nearest = heappop(waiting)
            done[nearest] = base
            if nearest not in self._column_of:
                return done, before, nearest, -1, base
            column = self._column_of[nearest]
            out = base + self._unmatched[column] - self._of_column[column]
            if out < least:
                left_out, least = column, out
