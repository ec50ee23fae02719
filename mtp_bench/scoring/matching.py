"""One-to-one matching of ragged rows: most pairs first, then minimum total cost.

All frames are matched at once; only larger components of pairs reach an assignment
solver. Among solutions of equal cost the one with the lower row, then the lower column
is preferred where the choice is ours.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints, in_groups
from .pairs import Pairs, Rows

Matched = NDArray[np.intp]
# largest dense table of costs: a few boxes that touch many objects would otherwise
# take all memory
_MAX_CELLS = 1 << 20


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
        """Return the components where ``mask`` [components] holds."""
        inside = mask[self.label]
        return _Contested(
            self.pairs.keep(inside),
            self.label[inside],
            self.rows,
            self.columns,
            self.local_row[inside],
            self.local_column[inside],
        )

    def parts(self) -> list[tuple[int, int]]:
        """Return the start and end of each component in the pairs."""
        first = np.flatnonzero(np.diff(self.label, prepend=-1))
        return list(pairwise([*first.tolist(), len(self.label)]))


def match(pairs: Pairs, rows: int) -> Matched:
    """Return the column matched to each row [rows], -1 for none.

    ``frame`` mode, without memory.
    """
    return _match(pairs, rows, _assign, squares=True)


def match_best(pairs: Pairs, rows: int) -> Matched:
    """Return the matching [rows] of least total cost, of any number of pairs.

    All costs are below 0, so no pair is left out that could be added. -1 for none.
    """
    return _match(pairs, rows, _cheapest_below_zero, squares=False)


def _match(
    pairs: Pairs, rows: int, assign: Callable[[Rows, Rows, Floats], Rows], squares: bool
) -> Matched:
    """Return the column matched to each row [rows].

    ``assign`` solves large components. ``squares``: components of 2 x 2 are solved
    without it.
    """
    matched = np.full(rows, -1, dtype=np.intp)
    contested_pairs = _settle_single(pairs, matched)
    if len(contested_pairs) == 0:
        return matched
    contested = _components(contested_pairs)
    settled = np.minimum(contested.rows, contested.columns) == 1
    _settle_star(contested.keep(settled), matched)
    if squares:
        square = (contested.rows == 2) & (contested.columns == 2)
        _settle_square(contested.keep(square), matched)
        settled |= square
    large = contested.keep(~settled)
    for low, high in large.parts():
        part = slice(low, high)
        chosen = low + assign(
            large.local_row[part], large.local_column[part], large.pairs.cost[part]
        )
        matched[large.pairs.row[chosen]] = large.pairs.column[chosen]
    return matched


def match_sticky(
    pairs: Pairs, rows: int, earlier_row: Ints, earlier_column: Ints
) -> Matched:
    """Match with memory: pairs of the frame before that are still inside come first.

    Returns the column matched to each row [rows], -1 for none. ``earlier_row`` [rows]
    and ``earlier_column`` [columns] give the row of the same object, the column of the
    same track, in the previous frame, -1 where it has none. Rows and columns are sorted
    by frame.
    """
    matched = np.full(rows, -1, dtype=np.intp)
    contested_pairs = _settle_single(pairs, matched)
    if len(contested_pairs) == 0:
        return matched
    contested = _components(contested_pairs)
    row = contested.pairs.row
    column = contested.pairs.column
    cost = contested.pairs.cost
    local_row = contested.local_row
    local_column = contested.local_column
    row_before = earlier_row[row]
    column_before = earlier_column[column]
    has_before = (row_before >= 0) & (column_before >= 0)

    def first_row(part: tuple[int, int]) -> int:
        return int(row[part[0]])

    # a component lies inside one frame; components in the order of their first row
    # follow time
    for low, high in sorted(contested.parts(), key=first_row):
        part = np.arange(low, high)
        was_matched = matched[row_before[part]] == column_before[part]
        sticky = part[has_before[part] & was_matched]
        if len(sticky):
            matched[row[sticky]] = column[sticky]
            excluded = local_row[part, None] == local_row[sticky]
            excluded |= local_column[part, None] == local_column[sticky]
            part = part[~excluded.any(axis=1)]
        if len(part):
            chosen = part[_assign(local_row[part], local_column[part], cost[part])]
            matched[row[chosen]] = column[chosen]
    return matched


def columns_to_rows(matched: Matched, columns: int) -> Matched:
    """Return the row matched to each column [columns], -1 for none.

    It is the inverse of a matching.
    """
    inverse = np.full(columns, -1, dtype=np.intp)
    row = np.flatnonzero(matched >= 0)
    inverse[matched[row]] = row
    return inverse


def _settle_single(pairs: Pairs, matched: Matched) -> Pairs:
    """Match the pairs without another candidate for row or column.

    They are written into ``matched``. Returns the other pairs.
    """
    row_pairs = np.bincount(pairs.row)
    column_pairs = np.bincount(pairs.column)
    single = (row_pairs[pairs.row] == 1) & (column_pairs[pairs.column] == 1)
    matched[pairs.row[single]] = pairs.column[single]
    return pairs.keep(~single)


def _components(pairs: Pairs) -> _Contested:
    """Return the connected components of ``pairs``, at least one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    row_node = np.unique(pairs.row, return_inverse=True)[1]
    column_node = np.unique(pairs.column, return_inverse=True)[1]
    rows = int(row_node.max()) + 1
    nodes = rows + int(column_node.max()) + 1
    edges = np.ones(len(row_node), dtype=np.int8)
    graph = coo_array((edges, (row_node, rows + column_node)), shape=(nodes, nodes))
    node_label = connected_components(graph, directed=False)[1]
    row_label, column_label = np.split(node_label, [rows])
    components = int(row_label.max()) + 1
    row_count, row_number = _numbered(row_label, components)
    column_count, column_number = _numbered(column_label, components)
    label = row_label[row_node].astype(np.intp)
    order = np.argsort(label, kind="stable")
    return _Contested(
        pairs.keep(order),
        label[order],
        row_count,
        column_count,
        row_number[row_node][order],
        column_number[column_node][order],
    )


def _numbered(label: Ints, components: int) -> tuple[Ints, Rows]:
    """Return the size of each component, and the number of each node within its own."""
    size = np.bincount(label, minlength=components)
    order = np.argsort(label, kind="stable")
    number = np.empty(len(label), dtype=np.intp)
    number[order] = in_groups(size)[1]
    return size, number


def _settle_star(contested: _Contested, matched: Matched) -> None:
    """Match the cheapest pair of components with one row or one column.

    It is written into ``matched``.
    """
    pairs = contested.pairs
    order = np.lexsort((pairs.column, pairs.row, pairs.cost, contested.label))
    first = order[np.diff(contested.label[order], prepend=-1) != 0]
    matched[pairs.row[first]] = pairs.column[first]


def _settle_square(contested: _Contested, matched: Matched) -> None:
    """Write the matching of components of 2 x 2 into ``matched``.

    A component has at least three of the four possible pairs, so that at least one of
    its two full matchings exists. The cheaper one is taken; a missing pair costs inf.
    """
    pairs = contested.pairs
    if len(pairs) == 0:
        return
    group = np.unique(contested.label, return_inverse=True)[1]
    count = int(group.max()) + 1  # of components
    row = np.empty((count, 2), np.intp)
    column = np.empty((count, 2), np.intp)
    cost = np.full((count, 2, 2), np.inf)
    row[group, contested.local_row] = pairs.row
    column[group, contested.local_column] = pairs.column
    cost[group, contested.local_row, contested.local_column] = pairs.cost
    crossed = cost[:, 0, 1] + cost[:, 1, 0] < cost[:, 0, 0] + cost[:, 1, 1]
    matched[row] = np.where(crossed[:, None], column[:, ::-1], column)


def _assign(row: Rows, column: Rows, cost: Floats) -> Rows:
    """Return the chosen pairs of one component or of a part of it.

    Rows and columns are its own numbers.
    """
    if len(row) == 1:
        return np.zeros(1, dtype=np.intp)
    size = min(int(row.max()), int(column.max())) + 1
    if size == 1:
        return np.array([np.argmin(cost)], dtype=np.intp)
    min_cost = float(cost.min())
    spread = float(cost.max()) - min_cost
    # one more pair always outweighs any sum of costs, without the rounding that a fixed
    # huge number brings
    absent = (size + 1) * spread if spread > 0 else 1.0
    return _cheapest(row, column, cost - min_cost, absent)


def _cheapest(row: Rows, column: Rows, cost: Floats, absent: float = 0.0) -> Rows:
    """Return the pairs of the cheapest full assignment.

    A pair that is not there costs ``absent``.
    """
    from scipy.optimize import linear_sum_assignment

    shape = int(row.max()) + 1, int(column.max()) + 1
    dense = np.full(shape, absent)
    dense[row, column] = cost
    pair_at = np.full(shape, -1, dtype=np.intp)
    pair_at[row, column] = np.arange(len(row))
    chosen = pair_at[linear_sum_assignment(dense)]
    return np.asarray(chosen[chosen >= 0])


def _cheapest_below_zero(row: Rows, column: Rows, cost: Floats) -> Rows:
    """Return the pairs of the cheapest assignment of costs below 0."""
    cells = (int(row.max()) + 1) * (int(column.max()) + 1)
    if cells > _MAX_CELLS:
        return _cheapest_sparse(row, column, cost)
    return _cheapest(row, column, cost)


def _cheapest_sparse(row: Rows, column: Rows, cost: Floats) -> Rows:
    """Do as `_cheapest_below_zero`, in memory that grows with the pairs alone."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    rows = int(row.max()) + 1
    columns = int(column.max()) + 1
    every_row = np.arange(rows)
    # each row may take a column of its own that costs nothing; a constant on all of
    # them changes no choice
    weight = np.concatenate([cost, np.zeros(rows)]) - float(cost.min()) + 1.0
    graph_row = np.concatenate([row, every_row])
    graph_column = np.concatenate([column, columns + every_row])
    graph = csr_array((weight, (graph_row, graph_column)), shape=(rows, columns + rows))
    chosen_row, chosen_column = min_weight_full_bipartite_matching(graph)
    matched = np.full(rows, -1, dtype=np.intp)
    matched[chosen_row] = chosen_column
    return np.flatnonzero(matched[row] == column)
