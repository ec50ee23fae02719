"""The k cheapest associations over all hypotheses in one search, from sparse gated costs.

Every row (track) of a hypothesis takes one of its allowed columns (detections) or none, which costs 0; a column serves
one row. What hypotheses have in common is solved once: see README.md.

Sources: Murty 1968; Jonker and Volgenant 1987; Miller, Stone and Cox 1997; Motro and Ghosh 2019.
"""

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, kernel, part
from .components import find_components, find_pieces
from .merge import merge
from .pieces import solve_pieces
from .tables import Pieces, Problem, Solutions, States


@kernel(
    "Tuple((f8[::1], i8[:, ::1], i8[::1]))(i8[::1], i8[::1], f8[::1], i8, b1[:, ::1], f8[::1], i8)"
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
    """Costs [k'], row_to_column [k', N] and parent [k'] of the at most ``k`` cheapest solutions of all parents.

    The allowed pairs of row r are ``column[indptr[r]:indptr[r + 1]]`` with their ``cost`` (compressed sparse rows:
    ``indptr`` [N + 1], the others [E]) of ``columns`` columns. ``member`` [H, N]: the rows of each parent, no two
    parents with the same. ``base_cost`` [H] is added to the solutions of its parent. Unmatched and absent rows have
    column -1. All costs are finite; no row has a column twice; H and k are at least 1. `mtp_bench.tracking.k_best`
    checks what it is given, this kernel does not.

    Best first; at equal cost the lower parent, then the lower columns from the first row on come first. Costs are sums
    over the rows in their order, base first. Which of several equally cheap solutions are the last to be kept is fixed
    but not defined. k' < k where there are fewer solutions.
    """
    problem = find_components(indptr, column, cost, columns)
    pieces = find_pieces(member, problem.rows, problem.start)
    solutions, total, limit = solve_pieces(problem, pieces, base_cost, k)
    chosen, states = merge(pieces, solutions, total, limit, k)
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
    q: int, solution: int, rows: Ints, pieces: Pieces, solutions: Solutions, pair: Ints
) -> None:
    """Write the pairs of a solution of piece ``q`` into ``pair``, by the caller's rows."""
    begin = pieces.begin[q]
    end = pieces.begin[q + 1]
    at = solutions.pair_at[solution] - begin
    for x in range(begin, end):
        pair[rows[pieces.places[x]]] = solutions.pairs[at + x]


@part
def write_solutions(
    chosen: Ints,
    states: States,
    problem: Problem,
    pieces: Pieces,
    solutions: Solutions,
    base: Floats,
    costs: Floats,
    parent: Ints,
    row_to_column: Ints,
) -> None:
    """Costs [k'], parents [k'] and columns [k', N] of the states ``chosen`` [k'].

    A cost is summed over the rows in their order, so that it does not depend on how the solution was found.
    """
    rows = problem.rows
    of_parent = pieces.of_parent
    N = row_to_column.shape[1]
    cheapest = np.empty((len(base), N), np.int64)
    written = np.zeros(len(base), np.bool_)
    for i in range(len(chosen)):
        p = states.parent[chosen[i]]
        state = chosen[i]
        if not written[p]:
            written[p] = True
            for row in range(N):
                cheapest[p, row] = -1
            for c in range(of_parent.shape[1]):
                if of_parent[p, c] >= 0:
                    q = of_parent[p, c]
                    write_pairs(
                        q, solutions.begin[q], rows, pieces, solutions, cheapest[p]
                    )
        for row in range(N):
            row_to_column[i, row] = cheapest[p, row]
        while state >= 0 and states.rank[state] > 0:
            q = states.piece[state]
            write_pairs(
                q,
                solutions.begin[q] + states.rank[state],
                rows,
                pieces,
                solutions,
                row_to_column[i],
            )
            state = states.under[state]
        total = base[p]
        for row in range(N):
            e = row_to_column[i, row]
            if e >= 0:
                total += problem.cost[e]
                row_to_column[i, row] = problem.column_of_caller[e]
        costs[i] = total
        parent[i] = p


@part
def comes_before(a: int, b: int, cost: Floats, parent: Ints, column: Ints) -> bool:
    """True if solution a is cheaper than b or, at equal cost, has the lower parent or the lower columns."""
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
def sort_solutions(
    cost: Floats, column: Ints, parent: Ints
) -> tuple[Floats, Ints, Ints]:
    """Costs, columns and parents of the solutions, cheapest first."""
    order = sorted_order(cost, parent, column)
    new_cost = np.empty(len(order))
    new_parent = np.empty(len(order), np.int64)
    new_column = np.empty(column.shape, np.int64)
    for i in range(len(order)):
        new_cost[i] = cost[order[i]]
        new_parent[i] = parent[order[i]]
        for row in range(column.shape[1]):
            new_column[i, row] = column[order[i], row]
    return new_cost, new_column, new_parent
