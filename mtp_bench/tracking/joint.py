"""The k cheapest partial matchings of a cost matrix, over all hypotheses at once."""

import numpy as np
from numpy.typing import ArrayLike

from ..core import Floats, Ints, ShapeError, require_shape
from .kernels.association import joint_k_best

_LARGEST = (
    4e307  # sum of costs: a gap is the difference of two sums, and must not overflow
)


def k_best(
    cost: ArrayLike,
    k: int,
    parents: ArrayLike | None = None,
    base_cost: ArrayLike | None = None,
) -> tuple[Floats, Ints, Ints]:
    """The at most ``k`` cheapest partial matchings, best first.

    ``cost`` [rows, columns]: what it costs to match; ``inf`` forbids, leaving a row unmatched costs 0. ``parents``: the
    row subsets to match, a boolean mask [parents, rows]; None is one parent with all rows. Parents with equal rows are
    merged, the cheapest (of equal ones the first) stands for them. ``base_cost`` [parents] is added to the solutions of
    its parent.

    Returns costs [k'], row_to_column [k', rows] with -1 for an unmatched or absent row, and parent [k'], where k' < k
    if there are fewer solutions. Equal input gives equal output; which of several solutions of equal cost is the last
    to be kept is not defined beyond that. Raises ShapeError for NaN, -inf, a wrong shape or k below 0.
    """
    matrix = np.asarray(cost, dtype=np.float64)
    require_shape("cost", matrix, (None, None))
    if k < 0:
        raise ShapeError(f"k is {k}, expected 0 or more")
    rows, columns = matrix.shape
    member = (
        np.ones((1, rows), dtype=bool)
        if parents is None
        else np.asarray(parents, dtype=bool)
    )
    require_shape("parents", member, (None, rows))
    base = (
        np.zeros(len(member))
        if base_cost is None
        else np.array(base_cost, dtype=np.float64)
    )
    require_shape("base_cost", base, (len(member),))
    row, column = np.ascontiguousarray(np.nonzero(matrix != np.inf))
    pair_cost = matrix[row, column]
    _require_finite(pair_cost, row, column, base)
    cheapest = np.argsort(base, kind="stable")
    kept = (
        np.sort(cheapest[np.unique(member[cheapest], axis=0, return_index=True)[1]])
        if len(base) > 1
        else cheapest
    )
    start = np.searchsorted(row, np.arange(rows + 1))
    choices = np.where(member[kept], np.diff(start) + 1.0, 1.0)
    with np.errstate(over="ignore"):
        k = int(
            min(k, choices.prod(axis=1).sum())
        )  # working space must not grow with an idle k
    if k == 0:
        return (
            np.empty(0),
            np.empty((0, rows), dtype=np.int64),
            np.empty(0, dtype=np.int64),
        )
    costs, row_to_column, parent = joint_k_best(
        start, column, pair_cost, columns, member[kept], base[kept], k
    )
    return costs, row_to_column, kept[parent]


def _require_finite(cost: Floats, row: Ints, column: Ints, base: Floats) -> None:
    """Raise ShapeError unless all costs are finite and can be summed."""
    for at in np.flatnonzero(~np.isfinite(cost)):
        raise ShapeError(
            f"cost[{row[at]}, {column[at]}] is {cost[at]}, expected a number or inf (forbidden)"
        )
    for at in np.flatnonzero(~np.isfinite(base)):
        raise ShapeError(f"base_cost has {base[at]}, expected finite numbers")
    with np.errstate(over="ignore"):
        largest = np.abs(cost).sum() + np.abs(base).max(initial=0.0)
    if not largest < _LARGEST:
        raise ShapeError(
            f"costs are too large to be summed: expected sums below {_LARGEST:g}"
        )
