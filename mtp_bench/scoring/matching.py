"""One-to-one matching of ragged rows: maximum cardinality first, then minimum total cost.

All frames are matched at once; only larger components of pairs reach an assignment solver. Among solutions of equal
cost the one with the lower row, then the lower column is preferred where the choice is ours.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints
from .pairs import Pairs, Rows

Matched = NDArray[np.intp]
_MOST_CELLS = (
    1 << 20
)  # of a dense table of costs: a few boxes that touch many objects must not choose the memory


@dataclass(frozen=True, eq=False)
class _Contested:
    """Pairs with competitors, sorted by connected component and then as they came."""

    pairs: Pairs
    label: Rows  # [E] component
    rows: Ints  # [components] number of rows
    columns: Ints  # [components] number of columns
    local_row: Rows  # [E] number of the row within its component
    local_column: Rows  # [E]

    def keep(self, mask: Bools) -> "_Contested":
        """The components where ``mask`` [components] holds."""
        inside = mask[self.label]
        label, row, column = (
            part[inside] for part in (self.label, self.local_row, self.local_column)
        )
        return replace(
            self,
            pairs=self.pairs.keep(inside),
            label=label,
            local_row=row,
            local_column=column,
        )

    def parts(self) -> list[tuple[int, int]]:
        """First and last place of each component."""
        first = np.flatnonzero(np.diff(self.label, prepend=-1))
        return list(pairwise([*first.tolist(), len(self.label)]))


def match(pairs: Pairs, rows: int) -> Matched:
    """Column matched to each row [rows], -1 for none; ``frame`` mode, without memory."""
    return _match(pairs, rows, _assign, squares=True)


def match_best(pairs: Pairs, rows: int) -> Matched:
    """Column matched to each row [rows], -1 for none: the matching of least total cost, of any cardinality.

    All costs are below 0, so no pair is left out that could be added.
    """
    return _match(pairs, rows, _cheapest_below_zero, squares=False)


def _match(
    pairs: Pairs, rows: int, assign: Callable[[Rows, Rows, Floats], Rows], squares: bool
) -> Matched:
    """Column matched to each row [rows]; ``assign`` solves large components, with ``squares`` not those of 2 x 2."""
    matched = np.full(rows, -1, dtype=np.intp)
    rest = _settle_single(pairs, matched)
    if len(rest):
        contested = _components(rest)
        small = np.minimum(contested.rows, contested.columns) == 1
        _settle_star(contested.keep(small), matched)
        if squares:
            square = (contested.rows == 2) & (contested.columns == 2)
            _settle_square(contested.keep(square), matched)
            small |= square
        large = contested.keep(~small)
        row, column, cost = large.pairs.row, large.pairs.column, large.pairs.cost
        for low, high in large.parts():
            chosen = low + assign(
                large.local_row[low:high], large.local_column[low:high], cost[low:high]
            )
            matched[row[chosen]] = column[chosen]
    return matched


def match_sticky(
    pairs: Pairs, rows: int, earlier_row: Ints, earlier_column: Ints
) -> Matched:
    """Column matched to each row [rows], -1 for none; pairs of the previous frame that are still inside are kept first.

    ``earlier_row`` [rows] and ``earlier_column`` [columns] give the row of the same object, the column of the same
    track, in the previous frame, -1 where it has none. Rows and columns are sorted by frame.
    """
    matched = np.full(rows, -1, dtype=np.intp)
    rest = _settle_single(pairs, matched)
    if len(rest) == 0:
        return matched
    contested = _components(rest)
    row, column, cost = (
        contested.pairs.row,
        contested.pairs.column,
        contested.pairs.cost,
    )
    before, old = earlier_row[row], earlier_column[column]
    known = (before >= 0) & (old >= 0)
    i, j = contested.local_row, contested.local_column
    # a component lies inside one frame; components in the order of their first row follow time
    for low, high in sorted(contested.parts(), key=lambda part: int(row[part[0]])):
        kept = low + np.flatnonzero(
            known[low:high] & (matched[before[low:high]] == old[low:high])
        )
        part = np.arange(low, high)
        if len(kept):
            matched[row[kept]] = column[kept]
            taken = (i[part, None] == i[kept]) | (j[part, None] == j[kept])
            part = part[~taken.any(axis=1)]
        if len(part):
            chosen = part[_assign(i[part], j[part], cost[part])]
            matched[row[chosen]] = column[chosen]
    return matched


def columns_to_rows(matched: Matched, columns: int) -> Matched:
    """Row matched to each column [columns], -1 for none: the inverse of a matching."""
    inverse = np.full(columns, -1, dtype=np.intp)
    row = np.flatnonzero(matched >= 0)
    inverse[matched[row]] = row
    return inverse


def _settle_single(pairs: Pairs, matched: Matched) -> Pairs:
    """Match the pairs whose row and column have no other candidate; returns the others."""
    if len(pairs) == 0:
        return pairs
    of_row, of_column = np.bincount(pairs.row), np.bincount(pairs.column)
    single = (of_row[pairs.row] == 1) & (of_column[pairs.column] == 1)
    matched[pairs.row[single]] = pairs.column[single]
    return pairs.keep(~single)


def _components(pairs: Pairs) -> _Contested:
    """Connected components of the pairs, at least one pair."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _, row_of = np.unique(pairs.row, return_inverse=True)
    _, column_of = np.unique(pairs.column, return_inverse=True)
    rows, nodes = int(row_of.max()) + 1, int(row_of.max() + column_of.max()) + 2
    graph = coo_array(
        (np.ones(len(row_of), dtype=np.int8), (row_of, rows + column_of)),
        shape=(nodes, nodes),
    )
    label_of_row, label_of_column = np.split(
        connected_components(graph, directed=False)[1], [rows]
    )
    label, count = label_of_row[row_of].astype(np.intp), int(label_of_row.max()) + 1
    order = np.argsort(label, kind="stable")
    row_count, local_row = _numbered(label_of_row, count)
    columns, local_column = _numbered(label_of_column, count)
    local_row, local_column = local_row[row_of][order], local_column[column_of][order]
    return _Contested(
        pairs.keep(order), label[order], row_count, columns, local_row, local_column
    )


def _numbered(label: Ints, count: int) -> tuple[Ints, Rows]:
    """Size of each of ``count`` components, and the number of each node within its own."""
    size = np.bincount(label, minlength=count)
    order = np.argsort(label, kind="stable")
    number = np.empty(len(label), dtype=np.intp)
    number[order] = np.arange(len(label)) - np.repeat(np.cumsum(size) - size, size)
    return size, number


def _settle_star(contested: _Contested, matched: Matched) -> None:
    """Components with one row or one column: the cheapest pair."""
    pairs, label = contested.pairs, contested.label
    order = np.lexsort((pairs.column, pairs.row, pairs.cost, label))
    first = order[np.diff(label[order], prepend=-1) != 0]
    matched[pairs.row[first]] = pairs.column[first]


def _settle_square(contested: _Contested, matched: Matched) -> None:
    """Connected components of two rows and two columns: one of the two full matchings."""
    pairs, i, j = contested.pairs, contested.local_row, contested.local_column
    if len(pairs) == 0:
        return
    _, group = np.unique(contested.label, return_inverse=True)
    count = int(group[-1]) + 1
    row, column, cost = (
        np.empty((count, 2), np.intp),
        np.empty((count, 2), np.intp),
        np.full((count, 2, 2), np.inf),
    )
    row[group, i], column[group, j], cost[group, i, j] = (
        pairs.row,
        pairs.column,
        pairs.cost,
    )
    crossed = cost[:, 0, 1] + cost[:, 1, 0] < cost[:, 0, 0] + cost[:, 1, 1]
    matched[row] = np.where(crossed[:, None], column[:, ::-1], column)


def _assign(row: Rows, column: Rows, cost: Floats) -> Rows:
    """Places of the chosen pairs of one component, or of what is left of it; rows and columns are its own numbers."""
    if len(row) == 1:
        return np.zeros(1, dtype=np.intp)
    rows, columns = int(row.max()) + 1, int(column.max()) + 1
    if min(rows, columns) == 1:
        return np.array([np.argmin(cost)], dtype=np.intp)
    least = float(cost.min())
    spread = float(cost.max()) - least
    # one more pair always outweighs any sum of costs, without the rounding that a fixed huge number brings
    return _cheapest(
        row,
        column,
        cost - least,
        (min(rows, columns) + 1) * spread if spread > 0 else 1.0,
    )


def _cheapest(row: Rows, column: Rows, cost: Floats, absent: float = 0.0) -> Rows:
    """Places of the pairs of the cheapest full assignment, in which a pair that is not there costs ``absent``."""
    from scipy.optimize import linear_sum_assignment

    shape = int(row.max()) + 1, int(column.max()) + 1
    dense, place = np.full(shape, absent), np.full(shape, -1, dtype=np.intp)
    dense[row, column], place[row, column] = cost, np.arange(len(row))
    chosen = place[linear_sum_assignment(dense)]
    return np.asarray(chosen[chosen >= 0])


def _cheapest_below_zero(row: Rows, column: Rows, cost: Floats) -> Rows:
    """Places of the pairs of the cheapest assignment of costs below 0."""
    cells = (int(row.max()) + 1) * (int(column.max()) + 1)
    return (_cheapest if cells <= _MOST_CELLS else _cheapest_sparse)(row, column, cost)


def _cheapest_sparse(row: Rows, column: Rows, cost: Floats) -> Rows:
    """As `_cheapest_below_zero`, in memory that grows with the pairs, not with rows x columns."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    rows, columns = int(row.max()) + 1, int(column.max()) + 1
    every, least = np.arange(rows), float(cost.min())
    # each row may take a column of its own that costs nothing; a constant on all of them changes no choice
    weight = np.concatenate([cost, np.zeros(rows)]) - least + 1.0
    at = np.concatenate([row, every]), np.concatenate([column, columns + every])
    graph = csr_array((weight, at), shape=(rows, columns + rows))
    chosen_row, chosen_column = min_weight_full_bipartite_matching(graph)
    taken = np.full(rows, -1, dtype=np.intp)
    taken[chosen_row] = chosen_column
    return np.flatnonzero(taken[row] == column)
