"""Solutions as costs and columns of the caller's rows."""

from __future__ import annotations

from typing import NamedTuple

from ...types import Floats, Ints
from .arrays import floats, int_table, ints, up_to
from .compile import kernel
from .tables import Pieces, Problem, Solutions, States


@kernel
def write_pairs(q: int, solution: int, rows: Ints, pieces: Pieces, solutions: Solutions, pair: Ints) -> None:
    """Write the pairs of a solution of piece ``q`` into ``pair``, by the caller's rows."""
    begin = pieces.begin[q]
    at = solutions.pair_at[solution] - begin
    for i in range(begin, pieces.begin[q + 1]):
        pair[rows[pieces.places[i]]] = solutions.pairs[at + i]


@kernel
def write_cheapest(p: int, N: int, rows: Ints, pieces: Pieces, solutions: Solutions, pair: Ints, own: Ints) -> int:
    """Write the cheapest solution of a parent into ``pair``, and the rows that it has into ``own``; how many."""
    for row in range(N):
        pair[row] = -2
    for c in range(pieces.of_parent.shape[1]):
        q = pieces.of_parent[p, c]
        if q >= 0:
            write_pairs(q, solutions.begin[q], rows, pieces, solutions, pair)
    used = 0
    for row in range(N):
        own[used] = row
        used += 1 if pair[row] > -2 else 0
    return used


@kernel
def write_changes(
    state: int, on: bool, states: States, rows: Ints, pieces: Pieces, solutions: Solutions, pair: Ints
) -> None:
    """Write what a state changes into ``pair``; back to the cheapest solution of the parent if not ``on``."""
    s = state
    while s >= 0 and states.rank[s] > 0:
        q = states.piece[s]
        write_pairs(q, solutions.begin[q] + (states.rank[s] if on else 0), rows, pieces, solutions, pair)
        s = states.under[s]


class Parents(NamedTuple):
    """What is written of each parent once: room for it."""

    pair: Ints  # [P, N] pair of each of the caller's rows in the solution that is being written
    own: Ints  # [P, N + 1] the rows that it has
    size: Ints  # [P] how many, -1: not written yet


@kernel
def write_solutions(
    chosen: Ints, states: States, problem: Problem, pieces: Pieces, solutions: Solutions, base: Floats, room: Parents,
    costs: Floats, row_to_column: Ints,
) -> None:  # fmt: skip
    """Costs [k'] and columns [k', N] of the states ``chosen`` [k'].

    A cost is summed over the rows in their order, so that it does not depend on how the solution was found.
    """
    N, rows = row_to_column.shape[1], problem.rows
    off = N < 0  # no literal, see compile.py
    for i in range(len(chosen)):
        p = states.parent[chosen[i]]
        pair, own = room.pair[p], room.own[p]
        if room.size[p] < 0:
            room.size[p] = write_cheapest(p, N, rows, pieces, solutions, pair, own)
        write_changes(chosen[i], not off, states, rows, pieces, solutions, pair)
        for row in range(N):
            row_to_column[i, row] = -1
        total = base[p]
        for j in range(room.size[p]):
            row = own[j]
            if pair[row] >= 0:
                total += problem.pair_cost[pair[row]]
                row_to_column[i, row] = problem.pair_column[pair[row]]
        costs[i] = total
        write_changes(chosen[i], off, states, rows, pieces, solutions, pair)


@kernel
def write_clusters(
    k: int, problem: Problem, pieces: Pieces, solutions: Solutions, costs: Floats, cluster: Ints, row_to_column: Ints
) -> None:
    """Costs, infinite at first, of the k best solutions of every cluster of every parent; their clusters and columns.

    ``costs`` [P C k], ``cluster`` [N], ``row_to_column`` [P k, N].
    """
    rows, begin = problem.rows, pieces.begin
    P, C = pieces.of_parent.shape
    for i in range(row_to_column.shape[0]):
        for row in range(row_to_column.shape[1]):
            row_to_column[i, row] = -1
    for c in range(C):
        for place in range(problem.start[c], problem.start[c + 1]):
            cluster[rows[place]] = c
    for p in range(P):
        for c in range(C):
            q = pieces.of_parent[p, c]
            if q < 0:
                costs[(p * C + c) * k] = 0.0  # no rows: one solution
                continue
            for i in range(k):
                rank = i if i < solutions.size[q] else 0
                if i < solutions.size[q]:
                    costs[(p * C + c) * k + i] = solutions.least[q] + solutions.gap[solutions.begin[q] + i]
                at = solutions.pair_at[solutions.begin[q] + rank] - begin[q]
                for x in range(begin[q], begin[q + 1]):
                    e = solutions.pairs[at + x]
                    row_to_column[p * k + i, rows[pieces.places[x]]] = problem.pair_column[e] if e >= 0 else -1


@kernel
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


@kernel
def sort_solutions(cost: Floats, parent: Ints, column: Ints) -> tuple[Floats, Ints, Ints]:
    """The solutions, cheapest first; see `comes_before`."""
    count, moved = len(cost), False
    order = up_to(count)
    for i in range(1, count):
        j = i
        while j > 0 and comes_before(i, order[j - 1], cost, parent, column):
            order[j] = order[j - 1]
            j -= 1
            moved = True
        order[j] = i
    if not moved:
        return cost, parent, column
    cost_out, parent_out, column_out = floats(count), ints(count), int_table(column.shape[0], column.shape[1])
    for i in range(count):
        cost_out[i], parent_out[i] = cost[order[i]], parent[order[i]]
        for row in range(column.shape[1]):
            column_out[i, row] = column[order[i], row]
    return cost_out, parent_out, column_out
