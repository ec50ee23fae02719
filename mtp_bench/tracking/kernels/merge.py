"""The k smallest sums over the pieces of each parent, for all parents in one queue.

The pieces of a parent are in the order of their first gap (how much dearer the second solution is than the first). A
state changes some pieces, the last of them, number ``a`` of the order, to its solution ``j`` >= 1. Its successors: the
next solution of that piece; the second solution of the next piece as well; if j = 1, that one instead. None costs less
than its origin, and each sum is reached in one way.
"""

from __future__ import annotations

import numpy as np

from ...types import Floats, Ints
from .arrays import first_floats, first_ints, floats, int_table, ints, ints_of
from .compile import kernel
from .heap import pop, push, sorted_numbers


@kernel
def by_first_gap(sol_begin: Ints, sol_count: Ints, gap: Floats, spare: float) -> Ints:
    """Pieces with a second solution that is dearer by at most ``spare``, by that gap."""
    names, first, size = ints(len(sol_begin)), floats(len(sol_begin)), 0
    for q in range(len(sol_begin)):
        if sol_count[q] > 1 and gap[sol_begin[q] + 1] <= spare:
            names[size], first[size] = q, gap[sol_begin[q] + 1]
            size += 1
    order = sorted_numbers(first_floats(first, size))
    for i in range(size):
        order[i] = names[order[i]]
    return order


@kernel
def merge(
    piece_of: Ints, component: Ints, sol_begin: Ints, sol_count: Ints, gap: Floats, total: Floats, limit: float, k: int
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """The at most k cheapest solutions over all parents, best first.

    ``gap``: how much dearer each solution of a piece is than its cheapest. ``total`` [P]: cost of the cheapest solution
    of each parent. What costs more than ``limit`` may be left out. Returns parent and state of each solution [k'] and,
    of each state, its piece, the rank of that piece's solution and the state with the other changes (-1: none).
    """
    P = len(total)
    least, best = np.inf, 0
    for p in range(P):
        if total[p] < least:
            least, best = total[p], p
    if k == 1:
        return ints_of(1, best), ints_of(1, -1), ints(0), ints(0), ints(0)
    ordered = by_first_gap(sol_begin, sol_count, gap, limit - least)
    pieces, used = ints(P * min(len(ordered), piece_of.shape[1])), 0
    stop = ints(P)
    most = P + 3 * k
    table = int_table(4, most)
    parent, place, rank, under = table[0], table[1], table[2], table[3]
    keys, names, size, states = floats(most), ints(most), 0 * P, P
    out_parent, out_state, found = ints(k), ints(k), 0
    for p in range(P):
        parent[p], place[p], rank[p], under[p] = p, -1, 0, -1
        if total[p] <= limit:
            size = push(keys, names, size, total[p], p)
    while size > 0 and found < k:
        size = pop(keys, names, size)
        s, key = names[size], keys[size]
        p, a = parent[s], place[s]
        if rank[s] == 0:  # the first of this parent: its pieces, in order
            a = used - 1
            for q in ordered:
                if piece_of[p, component[q]] == q:
                    pieces[used] = q
                    used += 1
            stop[p] = used
        out_parent[found], out_state[found] = p, s
        found += 1
        for kind in range(3):  # next solution; one more piece; another piece instead
            b, j, below, step = a + 1, 1, s, 0.0
            if kind == 0:
                b, j, below = a, rank[s] + 1, under[s]
            elif kind == 2:
                below = under[s]
            if (kind == 0 and rank[s] == 0) or (kind == 2 and rank[s] != 1) or b >= stop[p]:
                continue
            if j >= sol_count[pieces[b]]:
                continue
            step = gap[sol_begin[pieces[b]] + j]
            if kind != 1:
                step -= gap[sol_begin[pieces[a]] + rank[s]]
            if key + step > limit:
                continue
            parent[states], place[states], rank[states], under[states] = p, b, j, below
            size = push(keys, names, size, key + step, states)
            states += 1
    for s in range(states):
        place[s] = pieces[place[s]] if rank[s] > 0 else -1
        if under[s] < P:
            under[s] = -1
    return first_ints(out_parent, found), first_ints(out_state, found), place, rank, under
