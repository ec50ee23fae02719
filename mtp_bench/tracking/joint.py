"""The k cheapest associations over all hypotheses in one search, from sparse gated costs.

Every row (track) of a hypothesis takes one of its allowed columns (detections) or none, which costs 0; a column serves
one row. What hypotheses have in common is solved once: the gating components of all rows, and in each the distinct row
subsets. The kernels are in ``kernels/``; the first call compiles them, once per machine.

Sources: Murty 1968; Jonker and Volgenant 1987; Miller, Stone and Cox 1997; Motro and Ghosh 2019.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError
from ..types import Bools, Floats, Ints
from .kernels import association, checks
from .kernels.association import search

_Problem = tuple[Ints, Ints, Floats, int, Bools, Floats, int]


def joint_k_best(
    indptr: ArrayLike, column: ArrayLike, cost: ArrayLike, columns: int, member: ArrayLike, base_cost: ArrayLike, k: int
) -> tuple[Floats, Ints, Ints]:
    """Costs [k'], row_to_column [k', N] and parent [k'] of the at most ``k`` cheapest solutions of all parents.

    The allowed pairs of row r are ``column[indptr[r]:indptr[r + 1]]`` with their ``cost`` (compressed sparse rows:
    ``indptr`` [N + 1], the others [E]; ``inf`` forbids, as absence does) of ``columns`` columns. ``member`` [H, N]: the
    rows of each parent. ``base_cost`` [H] is added to the solutions of its parent. Of parents with equal rows the
    cheapest, of equal ones the first, stands for all. Unmatched and absent rows have column -1.

    Best first; at equal cost the lower parent, then the lower columns from the first row on come first. Costs are sums
    over the rows in their order, base first. Which of several equally cheap solutions are the last to be kept is fixed
    but not defined. k' < k where there are fewer solutions. Raises ShapeError for NaN, -inf, a column twice in a row,
    costs that overflow when summed, shapes that do not fit, or a negative k.
    """
    problem = _checked(indptr, column, cost, columns, member, base_cost, k)
    error, where, costs, row_to_column, parent = search(*problem, True, association.MOST_CHOICES)
    if error != checks.OK:
        _explain(error, where, problem)
    return costs, row_to_column, parent


@dataclass(frozen=True, eq=False)
class ClusterSolutions:
    """The best solutions of each cluster (gating component) of each of H parents."""

    cluster: Ints  # [N] cluster of a row; -1 for a row without an allowed pair, which has no choice
    cost: Floats  # [H, C, k] best first; inf where a cluster has fewer solutions
    row_to_column: Ints  # [H, k, N] each cluster's i-th best solution; its best where it has fewer


def cluster_k_best(
    indptr: ArrayLike, column: ArrayLike, cost: ArrayLike, columns: int, member: ArrayLike, base_cost: ArrayLike, k: int
) -> ClusterSolutions:
    """The ``k`` best solutions of every cluster of every parent.

    ``indptr``, ``column``, ``cost``, ``columns``, ``member``, ``base_cost`` and errors as for `joint_k_best`.

    Clusters share no column, so that ``row_to_column[h, i]`` is a solution of parent h for every i, and solution 0 is
    its cheapest: ``base_cost[h] + cost[h, :, 0].sum()``. Parents are not merged.
    """
    problem = _checked(indptr, column, cost, columns, member, base_cost, k)
    error, where, costs, row_to_column, cluster = search(*problem, False, association.MOST_CHOICES)
    if error != checks.OK:
        _explain(error, where, problem)
    parents, rows = problem[4].shape
    if parents * k == 0:
        return ClusterSolutions(cluster, np.empty((parents, 0, k)), np.full((parents, k, rows), -1, dtype=np.int64))
    return ClusterSolutions(cluster, costs.reshape(parents, -1, k), row_to_column.reshape(parents, k, rows))


def _checked(
    indptr: ArrayLike, column: ArrayLike, cost: ArrayLike, columns: int, member: ArrayLike, base_cost: ArrayLike, k: int
) -> _Problem:
    """The arguments as the kernels take them; what they can check is left to them."""
    if k >= 0 and columns >= 0 and _ready(indptr, column, cost, member, base_cost):
        return indptr, column, cost, columns, member, base_cost, k  # type: ignore[return-value]
    rows, mask = _array("indptr", indptr, _INT, 1), _array("member", member, _BOOL, 2)
    base = _array("base_cost", base_cost, _FLOAT, 1)
    if mask.shape != (len(base), len(rows) - 1):
        raise ShapeError(
            f"member has shape {mask.shape}, expected ({len(base)}, {len(rows) - 1}): len(base_cost), len(indptr) - 1"
        )
    if k < 0 or columns < 0:
        raise ShapeError(f"{'k' if k < 0 else 'columns'} is {min(k, columns)}, expected 0 or more")
    pairs, values = _array("column", column, _INT, 1), _array("cost", cost, _FLOAT, 1)
    return rows, pairs, values, int(columns), mask, base, int(k)


_INT, _BOOL, _FLOAT = np.dtype(np.int64), np.dtype(np.bool_), np.dtype(np.float64)
_KINDS = {_INT: "iu", _BOOL: "b", _FLOAT: "fiu"}


def _ready(indptr: Any, column: Any, cost: Any, member: Any, base_cost: Any) -> bool:
    """Whether all is as `_checked` would make it: so trackers call, several times a frame."""
    try:
        return (
            indptr.dtype is column.dtype is _INT
            and cost.dtype is base_cost.dtype is _FLOAT
            and member.dtype is _BOOL
            and indptr.flags.carray
            and column.flags.carray
            and cost.flags.carray
            and member.flags.carray
            and base_cost.flags.carray
            and indptr.ndim == column.ndim == cost.ndim == 1
            and member.shape == (*base_cost.shape, len(indptr) - 1)
        )
    except AttributeError:
        return False  # no array


def _array(name: str, given: ArrayLike, dtype: np.dtype[Any], dimensions: int) -> NDArray[Any]:
    """A contiguous array that can be written (the kernels are compiled for those, and leave it as it is)."""
    array = np.asarray(given)
    if array.dtype != dtype and array.size and array.dtype.kind not in _KINDS[dtype]:
        raise ShapeError(f"{name} has type {array.dtype}, expected {dtype}")
    if array.ndim != dimensions:
        raise ShapeError(f"{name} has shape {array.shape}, expected {dimensions} dimension{'s'[: dimensions - 1]}")
    array = np.ascontiguousarray(array, dtype)
    return array if array.flags.writeable else array.copy()


def _explain(error: int, where: int, problem: _Problem) -> NoReturn:
    indptr, column, cost, columns, _, base, _ = problem
    if error == checks.BAD_INDPTR:
        raise ShapeError(
            f"indptr does not fit: expected 0 at first, {len(column)} = len(column) at last, no decrease, and as many "
            f"costs as columns; got {indptr[:1]} ... {indptr[-1:]}, {len(cost)} costs, look at row {where}"
        )
    if error == checks.TOO_LARGE:
        raise ShapeError("costs are too large to be summed: expected sums below 4e307")
    if error == checks.BAD_BASE:
        raise ShapeError(f"base_cost has {base[where]}, expected finite numbers")
    row = int(np.searchsorted(indptr, where, side="right")) - 1
    if error == checks.BAD_COLUMN:
        raise ShapeError(f"column[{where}] (row {row}) is {column[where]}, expected 0 to {columns - 1}")
    if error == checks.REPEATED:
        raise ShapeError(f"row {row} has column {column[where]} twice, expected at most once")
    raise ShapeError(f"cost[{row}, {column[where]}] is {cost[where]}, expected a number or inf (forbidden)")


def k_best(
    cost: ArrayLike,
    k: int,
    parents: ArrayLike | Sequence[Iterable[int]] | None = None,
    base_cost: ArrayLike | None = None,
) -> tuple[Floats, Ints, Ints]:
    """The at most ``k`` cheapest partial matchings, best first: `joint_k_best` for costs that are not gated yet.

    ``cost`` [rows, columns]: what it costs to match; ``inf`` forbids, leaving a row unmatched costs 0. ``parents``: the
    row subsets to match, a boolean mask [parents, rows] or one list of row numbers each; None is one parent with all
    rows. Parents with equal rows are merged, the cheapest (of equal ones the first) stands for them. ``base_cost``
    [parents] is added to the solutions of its parent.

    Returns costs [k'], row_to_column [k', rows] with -1 for an unmatched or absent row, and parent [k'], where k' < k
    if there are fewer solutions. Equal input gives equal output; which of several solutions of equal cost is the last
    to be kept is not defined beyond that. Raises ShapeError for NaN, -inf, a wrong shape, a row that does not exist or
    a negative k.
    """
    matrix = np.asarray(cost, dtype=np.float64)
    if matrix.ndim != 2:
        raise ShapeError(f"cost has shape {matrix.shape}, expected (rows, columns)")
    rows, columns = matrix.shape
    member = np.ones((1, rows), dtype=bool) if parents is None else _members(parents, rows)
    base = np.zeros(len(member)) if base_cost is None else np.asarray(base_cost, dtype=np.float64)
    if base.shape != (len(member),):
        raise ShapeError(f"base_cost has shape {base.shape}, expected ({len(member)},), one per parent")
    row, column = np.nonzero(matrix != np.inf)  # NaN too: the kernels say where it is
    return joint_k_best(
        np.searchsorted(row, np.arange(rows + 1)), column, matrix[row, column], columns, member, base, k
    )


def _members(parents: Any, rows: int) -> Bools:
    """Rows of the parents as a mask [parents, rows]."""
    member = np.zeros((len(parents), rows), dtype=bool)
    for p, parent in enumerate(parents):
        member[p, _rows_of(p, parent, rows)] = True
    return member


def _rows_of(p: int, parent: Any, rows: int) -> Ints:
    """Rows of parent number ``p`` from a mask or from their numbers."""
    given = np.asarray(list(parent) if isinstance(parent, Iterable) else parent)
    if given.ndim == 1 and given.dtype == np.bool_:
        if len(given) != rows:
            raise ShapeError(f"parents[{p}] is a mask of {len(given)} rows, expected {rows} for this cost")
        return np.flatnonzero(given)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise ShapeError(f"parents[{p}] is {parent!r}, expected row numbers or a mask over the rows")
    subset = given.astype(np.int64)
    if subset.size and (subset.min() < 0 or subset.max() >= rows):
        wrong = subset.min() if subset.min() < 0 else subset.max()
        raise ShapeError(f"parents[{p}] names row {wrong} of {rows} rows")
    return subset
