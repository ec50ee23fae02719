"""Solutions as costs and columns of the caller's rows."""

from __future__ import annotations

import numpy as np

from ...types import Floats, Ints
from .compile import inlined, part
from .tables import Pieces, Problem, Solutions, States


@inlined
def write_pairs(q: int, solution: int, rows: Ints, pieces: Pieces, solutions: Solutions, pair: Ints) -> None:
    """Write the pairs of a solution of piece ``q`` into ``pair``, by the caller's rows."""
    begin, end = pieces.begin[q], pieces.begin[q + 1]
    at = solutions.pair_at[solution] - begin
    for x in range(begin, end):
        pair[rows[pieces.places[x]]] = solutions.pairs[at + x]


@part
def write_solutions(
    chosen: Ints, states: States, problem: Problem, pieces: Pieces, solutions: Solutions, base: Floats,
    costs: Floats, parent: Ints, row_to_column: Ints,
) -> None:  # fmt: skip
    """Costs [k'], parents [k'] and columns [k', N] of the states ``chosen`` [k'].

    A cost is summed over the rows in their order, so that it does not depend on how the solution was found.
    """
    rows, of_parent, N = problem.rows, pieces.of_parent, row_to_column.shape[1]
    cheapest, written = np.full((len(base), N), -1), np.zeros(len(base), np.bool_)
    for i in range(len(chosen)):
        p, state = states.parent[chosen[i]], chosen[i]
        if not written[p]:
            written[p] = True
            for c in range(of_parent.shape[1]):
                if of_parent[p, c] >= 0:
                    q = of_parent[p, c]
                    write_pairs(q, solutions.begin[q], rows, pieces, solutions, cheapest[p])
        for row in range(N):
            row_to_column[i, row] = cheapest[p, row]
        while state >= 0 and states.rank[state] > 0:
            q = states.piece[state]
            write_pairs(q, solutions.begin[q] + states.rank[state], rows, pieces, solutions, row_to_column[i])
            state = states.under[state]
        total = base[p]
        for row in range(N):
            e = row_to_column[i, row]
            if e >= 0:
                total += problem.cost[e]
                row_to_column[i, row] = problem.column_of_caller[e]
        costs[i], parent[i] = total, p


@part
def comes_before(a: int, b: int, cost: Floats, parent: Ints, column: Ints) -> bool:
    """Whether solution a is cheaper than b or, at equal cost, has the lower parent or the lower columns."""
    if cost[a] != cost[b]:
        return bool(cost[a] < cost[b])
    if parent[a] != parent[b]:
        return bool(parent[a] < parent[b])
    for row in range(column.shape[1]):
        if column[a, row] != column[b, row]:
            return bool(column[a, row] < column[b, row])
    return False


@part
def sorted_order(cost: Floats, parent: Ints, column: Ints) -> Ints:
    """The order of the solutions, cheapest first; see `comes_before`. They are nearly in order already."""
    order = np.arange(len(cost))
    for i in range(1, len(order)):
        j = i
        while j > 0 and comes_before(i, order[j - 1], cost, parent, column):
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


@part
def sort_solutions(cost: Floats, column: Ints, parent: Ints) -> tuple[Floats, Ints, Ints]:
    """Costs, columns and parents of the solutions, cheapest first."""
    order = sorted_order(cost, parent, column)
    new_cost, new_parent, new_column = np.empty_like(cost), np.empty_like(parent), np.empty_like(column)
    for i in range(len(order)):
        new_cost[i], new_parent[i] = cost[order[i]], parent[order[i]]
        for row in range(column.shape[1]):
            new_column[i, row] = column[order[i], row]
    return new_cost, new_column, new_parent
