"""The k cheapest partial matchings of a cost matrix, over all hypotheses at once."""

import numpy as np
from numpy.typing import ArrayLike

from ..core import Floats, Ints, ShapeError, require_shape
from .kernels.association import joint_k_best

# limit of the sum of costs: a gap is the difference of two sums, and must not overflow
_MAX_COST_SUM = 4e307


def k_best(
    cost: ArrayLike,
    k: int,
    parents: ArrayLike | None = None,
    base_cost: ArrayLike | None = None,
) -> tuple[Floats, Ints, Ints]:
    """Return the at most ``k`` cheapest partial matchings, best first.

    Args:
        cost: [rows, columns] of a match; ``inf`` forbids it, and leaving a row
            unmatched costs 0.
        k: largest number of matchings.
        parents: [parents, rows] boolean mask, the row subsets to match; None is one
            parent with all rows. Of parents with equal rows the cheapest (of equal ones
            the first) stands for all.
        base_cost: [parents] is added to the solutions of its parent.

    Returns:
        Costs [k'], row_to_column [k', rows] with -1 for an unmatched or absent row, and
        parent [k'], where k' < k if there are fewer solutions. Equal input gives equal
        output; which of several solutions of equal cost is the last to be kept is not
        defined beyond that.

    Raises:
        ShapeError: for NaN, -inf, a wrong shape or k below 0.
    """
    matrix = np.asarray(cost, dtype=np.float64)
    require_shape("cost", matrix, (None, None))
    if k < 0:
        raise ShapeError(f"k is {k}, expected 0 or more")
    rows, columns = matrix.shape
    member = np.ones((1, rows), dtype=bool)
    if parents is not None:
        member = np.asarray(parents, dtype=bool)
    require_shape("parents", member, (None, rows))
    base = np.zeros(len(member))
    if base_cost is not None:
        base = np.array(base_cost, dtype=np.float64)
    require_shape("base_cost", base, (len(member),))
    pair_row, pair_column = np.ascontiguousarray(np.nonzero(matrix != np.inf))
    pair_cost = matrix[pair_row, pair_column]
    _require_finite(pair_cost, pair_row, pair_column, base)
    # parents by cost; of those with equal rows the first alone
    distinct = np.argsort(base, kind="stable")
    if len(base) > 1:
        _, first = np.unique(member[distinct], axis=0, return_index=True)
        distinct = np.sort(distinct[first])
    start = np.searchsorted(pair_row, np.arange(rows + 1))
    # Each row has its pairs, or none: working space must not grow with k beyond the
    # number of solutions that these choices allow.
    choices = np.where(member[distinct], np.diff(start) + 1.0, 1.0)
    with np.errstate(over="ignore"):
        solutions = int(min(k, choices.prod(axis=1).sum()))
    if solutions == 0:
        no_rows = np.empty(0, dtype=np.int64)
        return np.empty(0), no_rows.reshape(0, rows), no_rows
    costs, row_to_column, parent = joint_k_best(
        start,
        pair_column,
        pair_cost,
        columns,
        member[distinct],
        base[distinct],
        solutions,
    )
    return costs, row_to_column, distinct[parent]


def _require_finite(
    pair_cost: Floats, pair_row: Ints, pair_column: Ints, base: Floats
) -> None:
    """Raise ShapeError unless all costs are finite and can be summed."""
    for pair in np.flatnonzero(~np.isfinite(pair_cost)):
        raise ShapeError(
            f"cost[{pair_row[pair]}, {pair_column[pair]}] is {pair_cost[pair]}, "
            "expected a number or inf (forbidden)"
        )
    for parent in np.flatnonzero(~np.isfinite(base)):
        raise ShapeError(f"base_cost has {base[parent]}, expected finite numbers")
    with np.errstate(over="ignore"):
        cost_sum = np.abs(pair_cost).sum() + np.abs(base).max(initial=0.0)
    if not cost_sum < _MAX_COST_SUM:
        raise ShapeError(
            f"costs are too large to be summed: expected sums below {_MAX_COST_SUM:g}"
        )
