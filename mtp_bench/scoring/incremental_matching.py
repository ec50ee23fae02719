"""Incremental matching: forecasts are added in turn, and a cut keeps those so far.

Added by falling confidence, they give the matchings of all cuts in one pass: each
addition changes one path.
"""

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ..core import Floats, Ints
from .matching import Matched
from .pairs import Pairs, Rows

NEVER = np.iinfo(np.intp).max  # the step of a column that is not added
# costs are integers in micrometres, so that the order of a sum does not matter
_MICRO = 1e6
_MAX_TIE_M = 1e3
_TIE_BITS = 40
_UNMATCHED = 1 << 120  # outweighs every sum of costs

_Change = tuple[int, int, int]  # step, row, column


@dataclass(frozen=True, eq=False)
class Additions:
    """Changes of a growing matching.

    At ``step`` [E], ascending, ``row`` [E] is matched to ``column`` [E] from then on. A
    matched row stays matched, possibly to other columns; a column that becomes
    unmatched stays unmatched.
    """

    step: Rows
    row: Rows
    column: Rows
    # [columns] the step from which each column is unmatched, NEVER where it stays
    # matched
    dropped: Rows


def add_in_order(
    pairs: Pairs, step: Rows, confidence: Floats, tie: Floats
) -> Additions:
    """Extend the matching by each column at its ``step`` [columns].

    The matching has the largest number of pairs. Among such matchings it has the surest
    columns, then the least cost, then the larger ``tie`` [E] of the pairs, m. Columns
    of equal ``confidence`` [columns] are one group, in which cost decides. Steps are
    distinct and come by falling confidence, so a matched column gives way to one of its
    own group alone; a column with step NEVER is not added. Costs are rounded to
    micrometres.
    """
    added = step[pairs.column] != NEVER
    pairs = pairs.keep(added)
    tie = tie[added]
    row_pairs = np.bincount(pairs.row)
    column_pairs = np.bincount(pairs.column, minlength=len(step))
    dropped = np.where(column_pairs > 0, NEVER, step)
    is_single = (row_pairs[pairs.row] == 1) & (column_pairs[pairs.column] == 1)
    single = pairs.keep(is_single)
    contested = pairs.keep(~is_single)
    changes: list[_Change] = []
    if len(contested):
        cost = _integer_costs(contested.cost, tie[~is_single])
        # only the order matters: matched sets form a matroid, so any falling weights
        # choose the same columns
        group = np.unique(confidence, return_inverse=True)[1]
        changes = _grow(contested, cost, step, group, dropped)
    grown = np.array(changes, dtype=np.intp).reshape(-1, 3)
    change_step = np.concatenate([step[single.column], grown[:, 0]])
    row = np.concatenate([single.row, grown[:, 1]])
    column = np.concatenate([single.column, grown[:, 2]])
    order = np.argsort(change_step, kind="stable")
    return Additions(change_step[order], row[order], column[order], dropped)


def final_match(additions: Additions, rows: int) -> Matched:
    """Return the column matched to each row [rows] in the end, -1 for none."""
    matched = np.full(rows, -1, dtype=np.intp)
    final_change = last_of(additions.row)
    matched[additions.row[final_change]] = additions.column[final_change]
    return matched


def last_of(values: Ints) -> NDArray[np.intp]:
    """Return the index of the last occurrence of each distinct value."""
    return len(values) - 1 - np.unique(values[::-1], return_index=True)[1]


def _integer_costs(cost: Floats, tie: Floats) -> list[int]:
    """Return one integer per pair that orders by cost, then tie.

    Sums are exact.
    The two are packed into bits of one integer: exact for components of up to about
    1 000 matched pairs, beyond which a sum of ties may carry over into the bits above.
    """
    finite_tie = np.minimum(np.where(np.isfinite(tie), tie, _MAX_TIE_M), _MAX_TIE_M)
    cost_um = np.rint(cost * _MICRO).astype(np.int64).tolist()
    tie_um = np.rint(finite_tie * _MICRO).astype(np.int64).tolist()
    return [(c << _TIE_BITS) - t for c, t in zip(cost_um, tie_um, strict=True)]


def _grow(
    pairs: Pairs, cost: list[int], step: Rows, group: Ints, dropped: Rows
) -> list[_Change]:
    """Add the columns by their ``step``: return the changes and fill in ``dropped``.

    The Hungarian method with one shortest path per column (Jonker and Volgenant 1987).
    Every column may also stay unmatched, at a cost above all others and the higher the
    surer it is. ``group`` [columns]: number of the confidence among all, the surest
    last. Paths stay inside the connected components of the pairs.
    """
    rows = pairs.row.tolist()
    columns = pairs.column.tolist()
    edges: dict[int, list[tuple[int, int]]] = {}
    for index in np.argsort(step[pairs.column], kind="stable").tolist():
        edges.setdefault(columns[index], []).append((rows[index], cost[index]))
    unmatched_cost = {column: _UNMATCHED * (1 + int(group[column])) for column in edges}
    matching = _Matching(edges, unmatched_cost)
    changes: list[_Change] = []
    for column in edges:
        column_step = int(step[column])
        path, left_out = matching.add(column)
        changes += [(column_step, row, new_column) for row, new_column in path]
        if left_out >= 0:
            dropped[left_out] = column_step
    return changes


class _Matching:
    """The optimal matching of the columns added so far, with the dual potentials."""

    def __init__(
        self, edges: dict[int, list[tuple[int, int]]], unmatched_cost: dict[int, int]
    ) -> None:
        self._edges = edges  # column -> rows inside the gate and their costs
        self._unmatched_cost = unmatched_cost  # by column
        self._row_of: dict[int, int] = {}
        self._column_of: dict[int, int] = {}
        self._column_potential: dict[int, int] = {}
        self._row_potential = {
            row: 0 for column_edges in edges.values() for row, _ in column_edges
        }

    def add(self, new_column: int) -> tuple[list[tuple[int, int]], int]:
        """Add a column.

        Returns the changed rows with their new columns, and the column that becomes
        unmatched, -1 for none.
        """
        self._column_potential[new_column] = min(
            cost - self._row_potential[row] for row, cost in self._edges[new_column]
        )
        distance, previous, end_row, left_out, total = self._shortest_path(new_column)
        # costs less potentials stay 0 or more, and are 0 for matched pairs
        self._column_potential[new_column] += total
        for row, row_distance in distance.items():
            if row in self._column_of:
                self._column_potential[self._column_of[row]] += total - row_distance
                self._row_potential[row] -= total - row_distance
        if end_row < 0 and left_out != new_column:
            end_row = self._row_of.pop(left_out)
        # back along the path, each column takes the next row
        path = []
        while end_row >= 0:
            column = previous[end_row]
            next_row = self._row_of.get(column, -1)
            self._row_of[column] = end_row
            self._column_of[end_row] = column
            path.append((end_row, column))
            end_row = next_row
        return path, left_out

    def _shortest_path(
        self, new_column: int
    ) -> tuple[dict[int, int], dict[int, int], int, int, int]:
        """Return the cheapest way to add a column.

        Distances and preceding columns of reached rows, the free row or -1, the
        unmatched column or -1, the cost.
        """
        best: dict[int, int] = {}
        previous: dict[int, int] = {}
        reached: dict[int, int] = {}
        # a heap of distances and rows; a row may be in it twice
        queue: list[tuple[int, int]] = []
        column = new_column
        base = 0
        # the column that is cheapest to leave unmatched so far, and its distance
        left_out = new_column
        limit = self._unmatched_cost[new_column] - self._column_potential[new_column]
        while True:
            offset = base - self._column_potential[column]
            for row, cost in self._edges[column]:
                distance = offset + cost - self._row_potential[row]
                # a row that is reached has its least distance already
                if distance < min(best.get(row, limit), limit):
                    best[row] = distance
                    previous[row] = column
                    heappush(queue, (distance, row))
            while queue and queue[0][1] in reached:
                heappop(queue)
            if not queue or queue[0][0] >= limit:
                return reached, previous, -1, left_out, limit
            base, nearest_row = heappop(queue)
            reached[nearest_row] = base
            if nearest_row not in self._column_of:
                return reached, previous, nearest_row, -1, base
            column = self._column_of[nearest_row]
            unmatched = self._unmatched_cost[column] - self._column_potential[column]
            if base + unmatched < limit:
                left_out = column
                limit = base + unmatched
