"""Textbook solver, the oracle of the kernels: the k cheapest partial matchings over all parents at once (Murty 1968).

Every row of a parent takes one allowed column or none; leaving a row unmatched costs 0 and a column serves one row.
Each solution found splits what is left of its parent's solutions into disjoint parts (forbid one of its choices, keep
those before it), so that no solution comes twice; one queue over all parents gives the best k of them together.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mtp_bench.errors import ShapeError
from mtp_bench.types import Floats, Ints

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
    cost: ArrayLike,
    k: int,
    parents: ArrayLike | Sequence[Iterable[int]] | None = None,
    base_cost: ArrayLike | None = None,
) -> tuple[Floats, Ints, Ints]:
    """The at most ``k`` cheapest partial matchings, best first.

    ``cost`` [rows, columns]: what it costs to match; ``inf`` forbids. ``parents``: the row subsets to match, a boolean
    mask [parents, rows] or one list of row numbers each; None is one parent with all rows. Parents with equal rows are
    merged, the cheapest (of equal ones the first) stands for them. ``base_cost`` [parents] is added to the solutions of
    its parent.

    Returns costs [k'], row_to_column [k', rows] with -1 for an unmatched or absent row, and parent [k'], where k' < k
    if there are fewer solutions. Equal input gives equal output; which of several solutions of equal cost comes first,
    or is the last to be kept, is not defined beyond that. Raises ShapeError for NaN, -inf, a wrong shape, a row that
    does not exist or a negative k.
    """
    matrix = _checked_cost(cost)
    if k < 0:
        raise ShapeError(f"k is {k}, expected 0 or more")
    subsets, base = _checked_parents(parents, base_cost, matrix.shape[0])
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


def _checked_cost(cost: ArrayLike) -> Floats:
    matrix = np.asarray(cost, dtype=np.float64)
    if matrix.ndim != 2:
        raise ShapeError(f"cost has shape {matrix.shape}, expected (rows, columns)")
    bad = np.isnan(matrix) | (matrix == -np.inf)
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        raise ShapeError(f"cost[{row}, {column}] is {matrix[row, column]}, expected a number or inf (forbidden)")
    return matrix


def _checked_parents(parents: Any, base_cost: ArrayLike | None, rows: int) -> tuple[list[Ints], Floats]:
    """Row subsets in increasing order, and their base costs."""
    subsets: list[Ints] = [np.arange(rows)]
    if parents is not None:
        subsets = [_rows_of(p, parent, rows) for p, parent in enumerate(parents)]
    base = np.zeros(len(subsets)) if base_cost is None else np.asarray(base_cost, dtype=np.float64)
    if base.shape != (len(subsets),):
        raise ShapeError(f"base_cost has shape {base.shape}, expected ({len(subsets)},), one per parent")
    if not np.isfinite(base).all():
        raise ShapeError(f"base_cost has {base[~np.isfinite(base)][0]}, expected finite numbers")
    return subsets, base


def _rows_of(p: int, parent: Any, rows: int) -> Ints:
    """Rows of parent number ``p`` in increasing order, from a mask or from their numbers."""
    given = np.asarray(list(parent) if isinstance(parent, Iterable) else parent)
    if given.ndim == 1 and given.dtype == np.bool_:
        if len(given) != rows:
            raise ShapeError(f"parents[{p}] is a mask of {len(given)} rows, expected {rows} for this cost")
        return np.flatnonzero(given)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise ShapeError(f"parents[{p}] is {parent!r}, expected row numbers or a mask over the rows")
    subset = np.unique(given.astype(np.int64))
    if subset.size and (subset[0] < 0 or subset[-1] >= rows):
        raise ShapeError(f"parents[{p}] names row {subset[0] if subset[0] < 0 else subset[-1]} of {rows} rows")
    return subset


def _distinct(subsets: list[Ints], active: list[Ints], base: Floats) -> list[tuple[int, Ints]]:
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

    Every row has a dummy column of its own at cost 0, which stands for "unmatched": private dummies leave no second
    way to write the same solution.
    """
    from scipy.optimize import linear_sum_assignment

    open_rows = rows[len(kept) :]
    if len(open_rows) == 0:
        return kept
    columns = matrix.shape[1]
    problem = np.full((len(open_rows), columns + len(open_rows)), np.inf)
    problem[:, :columns] = matrix[open_rows]
    problem[np.arange(len(open_rows)), columns + np.arange(len(open_rows))] = 0.0
    taken = [c for c in kept if c != UNMATCHED]
    problem[:, taken] = np.inf
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
