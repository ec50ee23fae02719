"""The k cheapest associations over all hypotheses in one search.

Every row (track) of a hypothesis takes one of its allowed columns (detections) or none,
which costs 0; a column serves one row. Costs are sparse and gated. What hypotheses have
in common is solved once: see README.md.

Sources: Murty 1968; Jonker and Volgenant 1987; Miller, Stone and Cox 1997; Motro and
Ghosh 2019.
"""

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, kernel, part
from .components import find_components, find_pieces
from .merge import merge
from .pieces import solve_pieces
from .tables import Pieces, Problem, Solutions, States


@kernel(
    "Tuple((f8[::1], i8[:, ::1], i8[::1]))"
    "(i8[::1], i8[::1], f8[::1], i8, b1[:, ::1], f8[::1], i8)"
)
def joint_k_best(
    indptr: Ints,
    column: Ints,
    cost: Floats,
    columns: int,
    member: Bools,
    base_cost: Floats,
    k: int,
) -> tuple[Floats, Ints, Ints]:
    """Find the at most ``k`` cheapest solutions of all parents.

    The allowed pairs of row r are ``column[indptr[r]:indptr[r + 1]]`` with their
    ``cost`` (compressed sparse rows: ``indptr`` [N + 1], the others [E]) of ``columns``
    columns. ``member`` [H, N]: the rows of each parent, no two parents with the same.
    ``base_cost`` [H] is added to the solutions of its parent. All costs are finite; no
    row has a column twice; H and k are at least 1. `mtp_bench.tracking.k_best` checks
    what it is given, this kernel does not.

    Returns costs [k'], row_to_column [k', N] and parent [k'], best first; k' < k where
    there are fewer solutions. Unmatched and absent rows have column -1. At equal cost
    the lower parent, then the lower columns from the first row on come first. Costs are
    sums over the rows in their order, base first. Which of several equally cheap
    solutions are the last to be kept is fixed but not defined.
    """
    problem = find_components(indptr, column, cost, columns)
    pieces = find_pieces(member, problem.rows, problem.row_start)
    solutions, totals, limit = solve_pieces(problem, pieces, base_cost, k)
    chosen, states = merge(pieces, solutions, totals, limit, k)
    costs = np.empty(len(chosen))
    parent = np.empty(len(chosen), np.int64)
    row_to_column = np.empty((len(chosen), member.shape[1]), np.int64)
    write_solutions(
        chosen,
        states,
        problem,
        pieces,
        solutions,
        base_cost,
        costs,
        parent,
        row_to_column,
    )
    return sort_solutions(costs, row_to_column, parent)


@inlined
def write_pairs(
    q: int,
    number: int,
    rows: Ints,
    pieces: Pieces,
    solutions: Solutions,
    row_to_pair: Ints,
) -> None:
    """Write the pairs of a piece's solution by the caller's rows."""
    start = pieces.row_start[q]
    end = pieces.row_start[q + 1]
    offset = solutions.pair_start[number] - start
    for x in range(start, end):
        row_to_pair[rows[pieces.places[x]]] = solutions.pairs[offset + x]


@part
def write_cheapest(
    p: int, rows: Ints, pieces: Pieces, solutions: Solutions, row_to_pair: Ints
) -> None:
    """Write the pairs [N] of the cheapest solution of parent ``p``."""
    row_to_pair[:] = -1
    for q in pieces.of_parent[p]:
        if q >= 0:
            write_pairs(q, solutions.first[q], rows, pieces, solutions, row_to_pair)


@part
def write_solutions(
    chosen: Ints,
    states: States,
    problem: Problem,
    pieces: Pieces,
    solutions: Solutions,
    base_cost: Floats,
    costs: Floats,
    parent: Ints,
    row_to_column: Ints,
) -> None:
    """Write costs, parents [k'] and columns [k', N] of states.

    The states are ``chosen`` [k']. A cost is summed over the rows in their order, so
    that it does not depend on how the solution was found.
    """
    rows = problem.rows
    N = row_to_column.shape[1]
    cheapest = np.empty((len(base_cost), N), np.int64)
    is_written = np.zeros(len(base_cost), np.bool_)
    for i in range(len(chosen)):
        state = chosen[i]
        p = states.parent[state]
        if not is_written[p]:
            is_written[p] = True
            write_cheapest(p, rows, pieces, solutions, cheapest[p])
        for row in range(N):
            row_to_column[i, row] = cheapest[p, row]
        while state >= 0 and states.rank[state] > 0:
            q = states.piece[state]
            number = solutions.first[q] + states.rank[state]
            write_pairs(q, number, rows, pieces, solutions, row_to_column[i])
            state = states.previous[state]
        total = base_cost[p]
        for row in range(N):
            e = row_to_column[i, row]
            if e >= 0:
                total += problem.pair_cost[e]
                row_to_column[i, row] = problem.caller_column[e]
        costs[i] = total
        parent[i] = p


@part
def comes_before(a: int, b: int, cost: Floats, parent: Ints, column: Ints) -> bool:
    """Compare two solutions by cost, then by parent, then by columns."""
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
    """Sort the numbers of solutions by `comes_before`, from nearly sorted ones."""
    order = np.arange(len(cost))
    for i in range(1, len(order)):
        j = i
        while j > 0 and comes_before(i, order[j - 1], cost, parent, column):
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


@part
def sort_solutions(
    cost: Floats, column: Ints, parent: Ints
) -> tuple[Floats, Ints, Ints]:
    """Sort costs, columns and parents of the solutions, cheapest first."""
    for i in range(1, len(cost)):
        if comes_before(i, i - 1, cost, parent, column):
            order = sorted_order(cost, parent, column)
            return cost[order], column[order], parent[order]
    return cost, column, parent
