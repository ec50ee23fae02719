"""The k smallest sums over the pieces of each parent, for all parents in one queue.

The pieces of a parent are in the order of their first gap (how much dearer the second solution is than the first). A
state changes some pieces, the last of them, number ``a`` of the order, to its solution ``j`` >= 1. Its successors: the
next solution of that piece; the second solution of the next piece as well; if j = 1, that one instead. None costs less
than its origin, and each sum is reached in one way.
"""

from typing import NamedTuple

import numpy as np

from ...core import Floats, Ints
from .compile import inlined, part
from .heap import pop, push, sorted_numbers
from .tables import Pieces, Solutions, States


class MergeQueue(NamedTuple):
    """States that wait, cheapest first."""

    keys: Floats
    names: Ints  # state of each key
    size: Ints  # [2] of the queue; number of states


@part
def by_first_gap(begin: Ints, count: Ints, gap: Floats, spare: float) -> Ints:
    """Pieces with a second solution that is dearer by at most ``spare``, by that gap."""
    numbers = np.empty(len(begin), np.int64)
    first = np.empty(len(begin))
    size = 0
    for q in range(len(begin)):
        if count[q] > 1 and gap[begin[q] + 1] <= spare:
            numbers[size] = q
            first[size] = gap[begin[q] + 1]
            size += 1
    order = sorted_numbers(first, size)
    for i in range(size):
        order[i] = numbers[order[i]]
    return order


@inlined
def pieces_in_order(
    p: int, ordered: Ints, pieces: Pieces, changeable: Ints, used: int
) -> int:
    """Write the pieces of parent ``p``, in their order, into ``changeable`` from ``used`` on; returns the end."""
    for q in ordered:
        if pieces.of_parent[p, pieces.component[q]] == q:
            changeable[used] = q
            used += 1
    return used


@inlined
def push_successors(
    s: int,
    key: float,
    limit: float,
    stop: int,
    changeable: Ints,
    solutions: Solutions,
    states: States,
    queue: MergeQueue,
) -> None:
    """Queue what follows state ``s``, which costs ``key``: next solution; one more piece; another piece instead.

    The pieces of its parent that can change are ``changeable`` [Q], in their order, up to number ``stop``. A state that
    would cost more than ``limit`` is left out. Writes the next row of ``states`` and an entry of ``queue`` for each.
    """
    begin = solutions.begin
    gap = solutions.gap
    a = states.piece[s]
    rank = states.rank[s]
    under = states.under[s]
    for kind in range(3):
        b = a + 1
        j = 1
        below = s
        if kind == 0:
            b = a
            j = rank + 1
            below = under
        elif kind == 2:
            below = under
        if (kind == 0 and rank == 0) or (kind == 2 and rank != 1) or b >= stop:
            continue
        if j >= solutions.size[changeable[b]]:
            continue
        step = gap[begin[changeable[b]] + j]
        if kind != 1:
            step -= gap[begin[changeable[a]] + rank]
        if key + step > limit:
            continue
        new = queue.size[1]
        states.parent[new], states.piece[new], states.rank[new], states.under[new] = (
            states.parent[s],
            b,
            j,
            below,
        )
        queue.size[0] = push(queue.keys, queue.names, queue.size[0], key + step, new)
        queue.size[1] = new + 1


@part
def expand(
    pieces: Pieces,
    solutions: Solutions,
    total: Floats,
    limit: float,
    ordered: Ints,
    changeable: Ints,
    stop: Ints,
    states: States,
    queue: MergeQueue,
    out: Ints,
) -> int:
    """Fill in the states, and in ``out`` [k] those of the solutions; how many there are.

    ``ordered``: the pieces that can change; ``changeable`` and ``stop``: room for those of each parent.
    """
    P = len(total)
    found = 0
    used = 0
    for p in range(P):
        states.parent[p], states.piece[p], states.rank[p], states.under[p] = (
            p,
            -1,
            0,
            -1,
        )
        if total[p] <= limit:
            queue.size[0] = push(queue.keys, queue.names, queue.size[0], total[p], p)
    queue.size[1] = P
    while queue.size[0] > 0 and found < len(out):
        size = pop(queue.keys, queue.names, queue.size[0])
        queue.size[0] = size
        s = queue.names[size]
        key = queue.keys[size]
        p = states.parent[s]
        if states.rank[s] == 0:  # the first of this parent: its pieces, in order
            states.piece[s] = used - 1
            used = pieces_in_order(p, ordered, pieces, changeable, used)
            stop[p] = used
        out[found] = s
        found += 1
        push_successors(s, key, limit, stop[p], changeable, solutions, states, queue)
    for s in range(queue.size[1]):
        states.piece[s] = changeable[states.piece[s]] if states.rank[s] > 0 else -1
        if states.under[s] < P:
            states.under[s] = -1
    return found


@part
def merge(
    pieces: Pieces, solutions: Solutions, total: Floats, limit: float, k: int
) -> tuple[Ints, States]:
    """The at most k cheapest solutions over all parents, best first, as states [k'], and all states.

    ``total`` [P]: cost of the cheapest solution of each parent. What costs more than ``limit`` may be left out.
    """
    P = len(total)
    ordered = by_first_gap(
        solutions.begin,
        solutions.size,
        solutions.gap,
        limit - total[sorted_numbers(total, P)[0]],
    )
    most = P + 3 * k
    changeable = np.empty(P * min(len(ordered), pieces.of_parent.shape[1]), np.int64)
    numbers = np.empty((5, most), np.int64)
    states = States(numbers[0], numbers[1], numbers[2], numbers[3])
    queue = MergeQueue(np.empty(most), numbers[4], np.zeros(2, np.int64))
    out = np.empty(k, np.int64)
    found = expand(
        pieces,
        solutions,
        total,
        limit,
        ordered,
        changeable,
        np.empty(P, np.int64),
        states,
        queue,
        out,
    )
    return out[:found], states
