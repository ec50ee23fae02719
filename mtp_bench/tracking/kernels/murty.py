"""The k cheapest solutions of a piece that can matter (Murty 1968), with what Miller, Stone and Cox (1997) inherit.

A node is a solution and the part of all solutions that it is the cheapest of: its first rows, in an order of its own,
keep their choices, and the row after them may not take some. What is left of the part without the solution itself is
split into disjoint children: child t keeps the first t rows and forbids the choice of the next. A child starts with the
matching and the potentials of its parent and needs one shortest alternating path. Rows come in descending slack (what
leaving their choice costs at least), so that the likely children have many rows fixed; children wait in the queue with
that lower bound and are solved only when nothing cheaper is left (Motro and Ghosh 2019).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import float_table, floats, int_table, ints
from .compile import kernel
from .heap import pop, push
from .shortest_path import HUB, change_potentials, cost_of, find_path, flip_path, forget_path
from .small import note


@kernel
def twice_as_long(array: Any) -> Any:
    """A longer copy."""
    longer = np.empty((2 * array.shape[0], array.shape[1]), array.dtype)
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            longer[i, j] = array[i, j]
    return longer


@kernel
def ban(nodes: Ints, q: int, t: int, n: int, banned: Bools, on: bool) -> bool:
    """Forbid what child ``t`` of node ``q`` may not take, or undo that; whether staying unmatched is forbidden."""
    row = nodes[q, n + t]
    hub = False
    while True:
        e = nodes[q, row]
        if e >= 0:
            banned[e] = on
        else:
            hub = True
        origin = nodes[q, 2 * n + 1]
        if origin < 0 or nodes[q, 2 * n] != t:
            return hub
        q = origin


@kernel
def lower_bounds(
    q: int, n: int, m: int, first: Ints, last: Ints, pair_local: Ints, pair_cost: Floats, banned: Bools,
    hub_banned: bool, nodes: Ints, potentials: Floats, out: Floats, enter: Floats,
) -> None:  # fmt: skip
    """What it costs at least that a row of node ``q`` leaves its choice, ``out`` [n].

    The path leaves the row by one pair and enters its column by another, or either way through the hub.
    """
    depth = nodes[q, 2 * n]
    for y in range(m):
        enter[y] = -potentials[q, n + y]
    for t in range(depth, n):
        x = nodes[q, n + t]
        ux, own = potentials[q, x], nodes[q, x]
        least = -ux if own >= 0 and not (t == depth and hub_banned) else np.inf
        for e in range(first[x], last[x]):
            if e != own:
                y = pair_local[e]
                slack = pair_cost[e] - ux - potentials[q, n + y]
                enter[y] = min(enter[y], slack)
                if slack < least and not (t == depth and banned[e]):
                    least = slack
        out[x] = least
    for t in range(depth, n):
        x = nodes[q, n + t]
        if nodes[q, x] >= 0:
            out[x] += max(enter[pair_local[nodes[q, x]]], 0.0)


@kernel
def sort_rows(q: int, n: int, nodes: Ints, out: Floats, spare: float) -> int:
    """Order the open rows of node ``q`` by descending slack, its own first; the first t whose child can matter.

    Rows that can not matter come first in any order.
    """
    low = nodes[q, 2 * n]
    if nodes[q, 2 * n + 1] >= 0:
        low += 1  # the row that may not take some keeps its place
    split = low
    for t in range(low, n):
        x = nodes[q, n + t]
        if out[x] > spare:
            nodes[q, n + t] = nodes[q, n + split]
            nodes[q, n + split] = x
            split += 1
    for t in range(split + 1, n):
        x = nodes[q, n + t]
        i = t
        while i > split and out[nodes[q, n + i - 1]] < out[x]:
            nodes[q, n + i] = nodes[q, n + i - 1]
            i -= 1
        nodes[q, n + i] = x
    return int(split)


@kernel
def load_child(
    q: int, t: int, n: int, m: int, pair_local: Ints, nodes: Ints, potentials: Floats,
    match: Ints, owner: Ints, u: Floats, v: Floats, row_out: Bools, column_out: Bools,
) -> None:  # fmt: skip
    """Solution and potentials of node ``q``, with its first ``t`` rows and their columns out."""
    for y in range(m):
        v[y], owner[y], column_out[y] = potentials[q, n + y], HUB, False
    for x in range(n):
        match[x], u[x], row_out[x] = nodes[q, x], potentials[q, x], False
        if match[x] >= 0:
            owner[pair_local[match[x]]] = x
    for i in range(t):
        x = nodes[q, n + i]
        row_out[x] = True
        if match[x] >= 0:
            column_out[pair_local[match[x]]] = True


@kernel
def save_child(
    q: int, t: int, new: int, n: int, m: int, nodes: Ints, potentials: Floats,
    match: Ints, u: Floats, v: Floats, cost: float,
) -> None:  # fmt: skip
    """Write child ``t`` of node ``q`` as node ``new``; its rows after number ``t`` in any order."""
    for x in range(n):
        nodes[new, x], nodes[new, n + x], potentials[new, x] = match[x], nodes[q, n + x], u[x]
    for y in range(m):
        potentials[new, n + y] = v[y]
    nodes[new, 2 * n], nodes[new, 2 * n + 1], potentials[new, n + m] = t, q, cost


@kernel
def split_node(
    q: int, n: int, m: int, first: Ints, last: Ints, pair_local: Ints, pair_cost: Floats, banned: Bools,
    nodes: Ints, potentials: Floats, out: Floats, enter: Floats, spare: float,
    key: float, waiting: Ints, waiting_t: Ints, records: int, keys: Floats, names: Ints, size: int,
) -> tuple[int, int]:  # fmt: skip
    """Queue the children of node ``q`` that can matter, with their lower bounds; new numbers of records and entries."""
    depth, is_root, hub_banned = nodes[q, 2 * n], nodes[q, 2 * n + 1] < 0, n < 0
    if not is_root:
        hub_banned = ban(nodes, q, depth, n, banned, not is_root)
    lower_bounds(
        q, n, m, first, last, pair_local, pair_cost, banned, hub_banned, nodes, potentials, out, enter
    )  # fmt: skip
    if not is_root:
        ban(nodes, q, depth, n, banned, is_root)
    split = sort_rows(q, n, nodes, out, spare)
    for t in range(depth, n):
        lower = out[nodes[q, n + t]]
        if (t >= split or (t == depth and not is_root)) and lower <= spare and lower < np.inf:
            waiting[records], waiting_t[records] = q, t
            size = push(keys, names, size, key + max(lower, 0.0), records)
            records += 1
    return records, size


@kernel(inline=True)
def best_solutions(
    n: int, m: int, k: int, first: Ints, last: Ints, pair_local: Ints, pair_cost: Floats, banned: Bools,
    root_cost: float, bound: Floats, roots: Floats, low: int, high: int, slack: float,
    match: Ints, owner: Ints, u: Floats, v: Floats, row_out: Bools, column_out: Bools,
    dist: Floats, through: Ints, by: Ints, seen: Ints, hub: Ints,
    order: Ints, sol_cost: Floats, sol_pair: Ints, at: int,
) -> int:  # fmt: skip
    """As `small.enumerate_solutions`, for pieces of any size; ``match``, ``u`` and ``v`` hold the root."""
    nodes = int_table(16, 2 * n + 2)  # pair of each row; order of the rows; depth and origin
    potentials = float_table(16, n + m + 1)  # of rows; of columns; cost
    most = 2 * k * n + 2
    waiting, waiting_t = ints(most), ints(most)
    keys, names = floats(most), ints(most)
    out, enter = floats(n), floats(m)
    zero, on, off = 0 * n, n > 0, n < 0  # no literals, see compile.py
    save_child(zero, zero, zero, n, m, nodes, potentials, match, u, v, root_cost)
    for x in range(n):
        nodes[0, n + x] = x
    nodes[0, 2 * n + 1] = -1
    waiting[0], waiting_t[0], keys[0], names[0] = 0, -1, root_cost, 0
    used, records, size, found = zero + 1, zero + 1, zero + 1, 0
    while size > 0:
        size = pop(keys, names, size)
        key, q, t = keys[size], waiting[names[size]], waiting_t[names[size]]
        spare = bound[k - 1] - roots[low] + slack - (key - root_cost)
        if spare < 0.0:
            break
        if t < 0:
            order[found], sol_cost[found] = found, potentials[q, n + m]
            for x in range(n):
                sol_pair[at + found * n + x] = nodes[q, x]
            found += 1
            if found == k:
                break
            records, size = split_node(
                q, n, m, first, last, pair_local, pair_cost, banned, nodes, potentials, out, enter, spare,
                key, waiting, waiting_t, records, keys, names, size,
            )  # fmt: skip
            continue
        load_child(q, t, n, m, pair_local, nodes, potentials, match, owner, u, v, row_out, column_out)
        source = nodes[q, n + t]
        target = zero + HUB
        if match[source] >= 0:
            target = pair_local[match[source]]
            owner[target] = HUB
        spare = bound[k - 1] - roots[low] + slack - (potentials[q, n + m] - root_cost)
        hub_banned = ban(nodes, q, t, n, banned, on)
        length, far = find_path(
            source, target, spare, hub_banned, n, m, first, last, pair_local, pair_cost, banned, match, owner, u, v,
            row_out, column_out, dist, through, by, seen, hub,
        )  # fmt: skip
        ban(nodes, q, t, n, banned, off)
        if length < np.inf:
            change_potentials(source, length, far, n, m, match, owner, u, v, row_out, column_out, dist, seen, hub)
            flip_path(source, target, pair_local, match, owner, through, by, hub)
            if used == len(nodes):
                nodes, potentials = twice_as_long(nodes), twice_as_long(potentials)
            cost = cost_of(match, pair_cost, n)
            save_child(q, t, used, n, m, nodes, potentials, match, u, v, cost)
            note(bound, roots, low, high, cost - root_cost)
            waiting[records], waiting_t[records] = used, -1
            size = push(keys, names, size, max(cost, key), records)
            used += 1
            records += 1
        forget_path(dist, seen, hub)
    for x in range(n):
        row_out[x] = False
    for y in range(m):
        column_out[y] = False
    return found
