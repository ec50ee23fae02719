"""Textbook solver, the oracle of the kernels: the k cheapest partial matchings over all parents at once (Murty 1968).

Every row of a parent takes one allowed column or none; leaving a row unmatched costs 0 and a column serves one row.
Each solution found splits the other solutions of its parent into disjoint parts; one queue gives the best k of all.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mtp_bench.core import Bools, Floats, Ints

UNMATCHED = -1


@dataclass(order=True)
class _Part:
    """The best solution of a part of one parent's solutions, and what defines that part."""

    cost: float
    parent: int
    choice: tuple[int, ...]  # column of each of the parent's active rows
    fixed: int = field(compare=False)  # the first rows keep their choice in all of the part
    forbidden: frozenset[int] = field(compare=False)  # columns that row number ``fixed`` may not take


def k_best(
    cost: Floats, k: int, parents: Bools | None = None, base_cost: Floats | None = None
) -> tuple[Floats, Ints, Ints]:
    """As `mtp_bench.tracking.k_best`, with parents as a mask [parents, rows], and without checks."""
    matrix = np.asarray(cost, dtype=np.float64)
    member = np.ones((1, len(matrix)), dtype=bool) if parents is None else parents
    subsets, base = [np.flatnonzero(rows) for rows in member], np.zeros(len(member)) if base_cost is None else base_cost
    # A row without an allowed column has no choice to make: it stays out of the search.
    allowed = np.asarray(np.isfinite(matrix).any(axis=1))
    active = [rows[allowed[rows]] for rows in subsets]
    queue = [_best_of(matrix, rows, float(base[p]), p) for p, rows in _distinct(subsets, active, base)]
    heapq.heapify(queue)
    found: list[_Part] = []
    while queue and len(found) < k:
        part = heapq.heappop(queue)
        found.append(part)
        if len(found) < k:
            for child in _split(matrix, active[part.parent], float(base[part.parent]), part):
                heapq.heappush(queue, child)
    row_to_column = np.full((len(found), matrix.shape[0]), UNMATCHED, dtype=np.int64)
    for i, part in enumerate(found):
        row_to_column[i, active[part.parent]] = part.choice
    costs = np.array([part.cost for part in found], dtype=np.float64)
    return costs, row_to_column, np.array([part.parent for part in found], dtype=np.int64)


def _distinct(subsets: Sequence[Ints], active: Sequence[Ints], base: Floats) -> list[tuple[int, Ints]]:
    """Cheapest parent of every distinct row subset, with its active rows."""
    cheapest: dict[bytes, int] = {}
    for p in np.argsort(base, kind="stable").tolist():
        cheapest.setdefault(subsets[p].tobytes(), p)
    return [(p, active[p]) for p in sorted(cheapest.values())]


def _best_of(matrix: Floats, rows: Ints, base: float, parent: int) -> _Part:
    choice = _solve(matrix, rows, (), frozenset())
    assert choice is not None  # leaving every row unmatched is always allowed
    return _Part(_total(matrix, rows, choice, base), parent, choice, 0, frozenset())


def _split(matrix: Floats, rows: Ints, base: float, part: _Part) -> list[_Part]:
    """Best solutions of the disjoint parts that remain of ``part`` without its own solution."""
    children = []
    for i in range(part.fixed, len(rows)):
        forbidden = frozenset({part.choice[i]}) | (part.forbidden if i == part.fixed else frozenset())
        choice = _solve(matrix, rows, part.choice[:i], forbidden)
        if choice is not None:
            # A part costs at least what the whole does: rounding must not let a later solution be a hair cheaper.
            cost = max(_total(matrix, rows, choice, base), part.cost)
            children.append(_Part(cost, part.parent, choice, i, forbidden))
    return children


def _solve(matrix: Floats, rows: Ints, kept: tuple[int, ...], forbidden: frozenset[int]) -> tuple[int, ...] | None:
    """Cheapest choice of columns where the first rows are kept and the next row avoids ``forbidden``; None if none.

    Every row has a dummy column of its own at cost 0, "unmatched": no solution can be written in a second way.
    """
    from scipy.optimize import linear_sum_assignment

    open_rows = rows[len(kept) :]
    if len(open_rows) == 0:
        return kept
    columns = matrix.shape[1]
    problem = np.full((len(open_rows), columns + len(open_rows)), np.inf)
    problem[:, :columns] = matrix[open_rows]
    problem[np.arange(len(open_rows)), columns + np.arange(len(open_rows))] = 0.0
    problem[:, [c for c in kept if c != UNMATCHED]] = np.inf
    for c in forbidden:
        problem[0, columns if c == UNMATCHED else c] = np.inf
    if not np.isfinite(problem[0]).any():
        return None
    try:
        _, chosen = linear_sum_assignment(problem)
    except ValueError:  # scipy's word for "no assignment without a forbidden entry"
        return None
    return kept + tuple(int(c) if c < columns else UNMATCHED for c in chosen)


def _total(matrix: Floats, rows: Ints, choice: tuple[int, ...], base: float) -> float:
    """Cost of a choice, summed in the order of the rows so that equal choices cost exactly the same."""
    total = base
    for row, column in zip(rows, choice, strict=True):
        if column != UNMATCHED:
            total += float(matrix[row, column])
    return total
