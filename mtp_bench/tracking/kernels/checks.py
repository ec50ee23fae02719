"""What can be wrong with a sparse association problem."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import ints_of
from .compile import kernel

OK, BAD_INDPTR, BAD_COLUMN, BAD_COST, BAD_BASE, REPEATED, TOO_LARGE = range(7)
LARGEST = 4e307  # sum of costs: a gap is the difference of two sums, and must not overflow


@kernel
def check(indptr: Ints, column: Ints, cost: Floats, columns: int, base: Floats) -> tuple[int, int, float]:
    """What is wrong with a sparse problem, where, and what no total can exceed."""
    n = len(indptr) - 1
    if n < 0 or indptr[0] != 0 or indptr[n] != len(column) or len(cost) != len(column):
        return BAD_INDPTR, 0, 0.0
    largest, row_of = 0.0, ints_of(columns, -1)
    for row in range(n):
        if indptr[row] > indptr[row + 1] or indptr[row + 1] > len(column):
            return BAD_INDPTR, row, 0.0
        most = 0.0
        for e in range(indptr[row], indptr[row + 1]):
            if column[e] < 0 or column[e] >= columns:
                return BAD_COLUMN, e, 0.0
            if row_of[column[e]] == row:
                return REPEATED, e, 0.0
            row_of[column[e]] = row
            if not cost[e] > -np.inf:
                return BAD_COST, e, 0.0
            if cost[e] < np.inf:
                most = max(most, abs(cost[e]))
        largest += most
    most = 0.0
    for p in range(len(base)):
        if not abs(base[p]) < np.inf:
            return BAD_BASE, p, 0.0
        most = max(most, abs(base[p]))
    return (OK if largest + most < LARGEST else TOO_LARGE), 0, largest + most


@kernel
def at_most(indptr: Ints, member: Bools, k: int) -> int:
    """``k``, or fewer if the choices of the rows are fewer: working space must not grow with an idle k."""
    most = 0.0
    for p in range(member.shape[0]):
        product = 1.0
        for row in range(member.shape[1]):
            if member[p, row]:
                product *= indptr[row + 1] - indptr[row] + 1
                if product >= k:
                    break
        most += product
        if most >= k:
            return k
    return int(most)
