"""The k cheapest associations over all hypotheses in one search, from sparse gated costs.

Every row (track) of a hypothesis takes one of its allowed columns (detections) or none, which costs 0; a column serves
one row. What hypotheses have in common is solved once: see README.md.

Sources: Murty 1968; Jonker and Volgenant 1987; Miller, Stone and Cox 1997; Motro and Ghosh 2019.
"""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .compile import kernel, part
from .components import find_components, find_pieces
from .merge import merge
from .pieces import solve_pieces
from .write import sort_solutions, write_solutions


@kernel("Tuple((f8[::1], i8[:, ::1], i8[::1]))(i8[::1], i8[::1], f8[::1], i8, b1[:, ::1], f8[::1], i8)")
def joint_k_best(
    indptr: Ints, column: Ints, cost: Floats, columns: int, member: Bools, base_cost: Floats, k: int
) -> tuple[Floats, Ints, Ints]:
    """Costs [k'], row_to_column [k', N] and parent [k'] of the at most ``k`` cheapest solutions of all parents.

    The allowed pairs of row r are ``column[indptr[r]:indptr[r + 1]]`` with their ``cost`` (compressed sparse rows:
    ``indptr`` [N + 1], the others [E]) of ``columns`` columns. ``member`` [H, N]: the rows of each parent, no two
    parents with the same. ``base_cost`` [H] is added to the solutions of its parent. Unmatched and absent rows have
    column -1. All costs are finite; no row has a column twice. `mtp_bench.tracking.k_best` checks what it is given,
    this kernel does not.

    Best first; at equal cost the lower parent, then the lower columns from the first row on come first. Costs are sums
    over the rows in their order, base first. Which of several equally cheap solutions are the last to be kept is fixed
    but not defined. k' < k where there are fewer solutions.
    """
    k = number_wanted(indptr, member, k)
    if k < 1:
        return np.empty(0), np.empty((0, member.shape[1]), np.int64), np.empty(0, np.int64)
    problem = find_components(indptr, column, cost, columns)
    pieces = find_pieces(member, problem.rows, problem.start)
    solutions, total, limit = solve_pieces(problem, pieces, base_cost, k)
    chosen, states = merge(pieces, solutions, total, limit, k)
    costs, parent = np.empty(len(chosen)), np.empty(len(chosen), np.int64)
    row_to_column = np.empty((len(chosen), member.shape[1]), np.int64)
    write_solutions(chosen, states, problem, pieces, solutions, base_cost, costs, parent, row_to_column)
    return sort_solutions(costs, row_to_column, parent)


@part
def number_wanted(indptr: Ints, member: Bools, k: int) -> int:
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
