"""The k smallest sums over the pieces of each parent, for all parents in one queue.

The pieces of a parent are in the order of their first gap (how much dearer the second
solution is than the first). A state changes some pieces, the last of them, number ``a``
of the order, to its solution ``j`` >= 1. Its successors: the next solution of that
piece; the second solution of the next piece as well; if j = 1, that one instead. None
costs less than its origin, and each sum is reached in one way.
"""

from typing import NamedTuple

import numpy as np

from ...core import Floats, Ints
from .compile import inlined, part
from .heap import pop, push, sorted_numbers
from .tables import Pieces, Solutions, States

# kinds of successors
_NEXT_SOLUTION, _ONE_MORE_PIECE, _OTHER_PIECE = range(3)


class MergeQueue(NamedTuple):
    """States that wait, cheapest first."""

    keys: Floats
    names: Ints  # state of each key
    size: Ints  # [2] of the queue; number of states


@part
def by_first_gap(solutions: Solutions, max_gap: float) -> Ints:
    """Sort the pieces that can change by their first gap.

    It is that of their second solution, which is dearer by at most ``max_gap``.
    """
    piece_count = len(solutions.first)
    numbers = np.empty(piece_count, np.int64)
    first_gap = np.empty(piece_count)
    size = 0
    for q in range(piece_count):
        second = solutions.first[q] + 1
        if solutions.solution_count[q] > 1 and solutions.gap[second] <= max_gap:
            numbers[size] = q
            first_gap[size] = solutions.gap[second]
            size += 1
    return numbers[sorted_numbers(first_gap, size)]


@inlined
def pieces_in_order(
    p: int, ordered: Ints, pieces: Pieces, changeable: Ints, count: int
) -> int:
    """Append the pieces of a parent, in order and count all.

    There are ``count`` changeable pieces already.
    """
    for q in ordered:
        if pieces.of_parent[p, pieces.component[q]] == q:
            changeable[count] = q
            count += 1
    return count


@inlined
def add_state(
    number: int, parent: int, piece: int, rank: int, previous: int, states: States
) -> None:
    """Write the row of a state."""
    states.parent[number] = parent
    states.piece[number] = piece
    states.rank[number] = rank
    states.previous[number] = previous


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
    """Queue the successors of state ``s`` within the limit.

    It costs ``key``. The pieces of its parent that can change are ``changeable`` [Q],
    in their order, up to number ``stop``. Writes the next row of ``states`` and an
    entry of ``queue`` for each successor.
    """
    first = solutions.first
    gap = solutions.gap
    a = states.piece[s]
    rank = states.rank[s]
    # without a change there is no next solution; only a second solution moves on
    for kind in range(int(rank == 0), 2 + int(rank == 1)):
        b = a + 1
        new_rank = 1
        previous = states.previous[s]
        if kind == _NEXT_SOLUTION:
            b = a
            new_rank = rank + 1
        elif kind == _ONE_MORE_PIECE:
            previous = s
        if b >= stop or new_rank >= solutions.solution_count[changeable[b]]:
            continue
        rise = gap[first[changeable[b]] + new_rank]
        if kind != _ONE_MORE_PIECE:
            rise -= gap[first[changeable[a]] + rank]
        if key + rise > limit:
            continue
        number = queue.size[1]
        add_state(number, states.parent[s], b, new_rank, previous, states)
        queue.size[0] = push(queue.keys, queue.names, queue.size[0], key + rise, number)
        queue.size[1] = number + 1


@part
def expand(
    pieces: Pieces,
    solutions: Solutions,
    totals: Floats,
    limit: float,
    ordered: Ints,
    changeable: Ints,
    stop: Ints,
    states: States,
    queue: MergeQueue,
    chosen: Ints,
) -> int:
    """Write the states and choose the solutions and return their number.

    ``ordered``: the pieces that can change; ``changeable`` and ``stop``: room for those
    of each parent; ``chosen`` [k]: states of the solutions.
    """
    P = len(totals)
    count = 0
    piece_count = 0
    for p in range(P):
        add_state(p, p, -1, 0, -1, states)
        if totals[p] <= limit:
            queue.size[0] = push(queue.keys, queue.names, queue.size[0], totals[p], p)
    queue.size[1] = P
    while queue.size[0] > 0 and count < len(chosen):
        size = pop(queue.keys, queue.names, queue.size[0])
        queue.size[0] = size
        s = queue.names[size]
        key = queue.keys[size]
        p = states.parent[s]
        if states.rank[s] == 0:  # the first of this parent: its pieces, in order
            states.piece[s] = piece_count - 1
            piece_count = pieces_in_order(p, ordered, pieces, changeable, piece_count)
            stop[p] = piece_count
        chosen[count] = s
        count += 1
        push_successors(s, key, limit, stop[p], changeable, solutions, states, queue)
    for s in range(queue.size[1]):
        if states.rank[s] > 0:
            states.piece[s] = changeable[states.piece[s]]
        else:
            states.piece[s] = -1
        if states.previous[s] < P:
            states.previous[s] = -1
    return count


@part
def merge(
    pieces: Pieces, solutions: Solutions, totals: Floats, limit: float, k: int
) -> tuple[Ints, States]:
    """Find the at most k cheapest solutions over all parents.

    Returns them as states [k'], best first, and all states. ``totals`` [P]: cost of the
    cheapest solution of each parent. What costs more than ``limit`` may be left out.
    """
    P = len(totals)
    ordered = by_first_gap(solutions, limit - totals[sorted_numbers(totals, P)[0]])
    max_states = P + 3 * k
    changeable = np.empty(P * min(len(ordered), pieces.of_parent.shape[1]), np.int64)
    numbers = np.empty((5, max_states), np.int64)
    states = States(numbers[0], numbers[1], numbers[2], numbers[3])
    queue = MergeQueue(np.empty(max_states), numbers[4], np.zeros(2, np.int64))
    chosen = np.empty(k, np.int64)
    count = expand(
        pieces,
        solutions,
        totals,
        limit,
        ordered,
        changeable,
        np.empty(P, np.int64),
        states,
        queue,
        chosen,
    )
    return chosen[:count], states
