"""Solutions as costs and columns of the caller's rows."""

from __future__ import annotations

import numpy as np

from ...types import Floats, Ints
from .arrays import floats, floats_of, int_table, ints, ints_of, up_to
from .compile import kernel


@kernel
def write_pairs(
    piece: int, solution: int, begin: Ints, places: Ints, rows: Ints, pair_at: Ints, pairs: Ints, into: Ints, p: int
) -> None:
    """Write the pairs of a piece's solution into row ``p`` of ``into`` [.., N]."""
    at = pair_at[solution] - begin[piece]
    for i in range(begin[piece], begin[piece + 1]):
        into[p, rows[places[i]]] = pairs[at + i]


@kernel
def write_solutions(
    parent: Ints, state: Ints, piece: Ints, rank: Ints, under: Ints, parents: Ints, base: Floats, rows: Ints,
    pair_cost: Floats, pair_column: Ints, begin: Ints, places: Ints, piece_of: Ints, sol_begin: Ints, pair_at: Ints,
    pairs: Ints, out_cost: Floats, row_to_column: Ints,
) -> None:  # fmt: skip
    """Costs and columns of the merged solutions; ``parent`` gets the numbers of the caller."""
    P, N = len(parents), row_to_column.shape[1]
    chosen, own, count = int_table(P, N), int_table(P, N + 1), ints_of(P, -1)
    for i in range(len(parent)):
        p = parent[i]
        if count[p] < 0:
            for row in range(N):
                chosen[p, row] = -2
            for c in range(piece_of.shape[1]):
                q = piece_of[p, c]
                if q >= 0:
                    write_pairs(q, sol_begin[q], begin, places, rows, pair_at, pairs, chosen, p)
            used = 0
            for row in range(N):
                own[p, used] = row
                used += 1 if chosen[p, row] > -2 else 0
            count[p] = used
        s = state[i]
        while s >= 0 and rank[s] > 0:
            write_pairs(piece[s], sol_begin[piece[s]] + rank[s], begin, places, rows, pair_at, pairs, chosen, p)
            s = under[s]
        total = base[p]
        for row in range(N):
            row_to_column[i, row] = -1
        for j in range(count[p]):
            row = own[p, j]
            e = chosen[p, row]
            if e >= 0:
                total += pair_cost[e]
                row_to_column[i, row] = pair_column[e]
        s = state[i]
        while s >= 0 and rank[s] > 0:  # back to the cheapest solution of the parent
            write_pairs(piece[s], sol_begin[piece[s]] + 0 * s, begin, places, rows, pair_at, pairs, chosen, p)
            s = under[s]
        out_cost[i], parent[i] = total, parents[p]


@kernel
def write_clusters(
    k: int, start: Ints, pair_column: Ints, begin: Ints, places: Ints, rows: Ints, piece_of: Ints, sol_begin: Ints,
    sol_count: Ints, root_cost: Floats, gap: Floats, pair_at: Ints, pairs: Ints, cluster: Ints, row_to_column: Ints,
) -> Floats:  # fmt: skip
    """Costs of the k best solutions of every cluster of every parent, flat; fills in clusters and columns."""
    P, C = piece_of.shape
    costs = floats_of(P * C * k, np.inf)
    for i in range(row_to_column.shape[0]):
        for row in range(row_to_column.shape[1]):
            row_to_column[i, row] = -1
    for c in range(C):
        for place in range(start[c], start[c + 1]):
            cluster[rows[place]] = c
    for p in range(P):
        for c in range(C):
            q = piece_of[p, c]
            if q < 0:
                costs[(p * C + c) * k] = 0.0  # no rows: one solution
                continue
            for i in range(k):
                rank = i if i < sol_count[q] else 0
                if i < sol_count[q]:
                    costs[(p * C + c) * k + i] = root_cost[q] + gap[sol_begin[q] + i]
                at = pair_at[sol_begin[q] + rank] - begin[q]
                for x in range(begin[q], begin[q + 1]):
                    e = pairs[at + x]
                    row_to_column[p * k + i, rows[places[x]]] = pair_column[e] if e >= 0 else -1
    return costs


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
