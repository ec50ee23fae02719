"""Murty's search (1968) for the k cheapest solutions of a piece; children inherit as in Miller, Stone and Cox (1997).

A node is a solution and the part of all solutions that it is the cheapest of: its first rows, in an order of its own,
keep their choices, and the row after them may not take some. What is left of the part without the solution itself is
split into disjoint children: child t keeps the first t rows and forbids the choice of the next. A child starts with the
matching and the potentials of its parent and needs one shortest alternating path. Rows come in descending slack (what
leaving their choice costs at least), so that the likely children have many rows fixed; children wait in the queue with
that lower bound and are solved only when nothing cheaper is left (Motro and Ghosh 2019).
"""

from typing import Any, NamedTuple

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import part
from .enumeration import limit_of, note
from .heap import pop, push
from .shortest_path import (
    HUB,
    change_potentials,
    cost_of,
    find_path,
    flip_path,
    forget_path,
)
from .tables import Block, Bound, Kept, Matching, Path


class Nodes(NamedTuple):
    """The nodes of the search, a row each."""

    table: Ints  # [.., 2 n + 2] the pair of each row; the order of the rows; fixed rows; the node that it is a child of
    potentials: Floats  # [.., n + m + 1] of rows; of columns; the cost of the solution


class SearchQueue(NamedTuple):
    """Entries that wait: the solution of ``node[i]``, or its unsolved child number ``child[i]``."""

    keys: Floats  # the heap of costs and lower bounds
    names: Ints  # entry of each key
    node: Ints
    child: Ints  # -1: the solution itself


class Slacks(NamedTuple):
    """Lower bounds of what it costs to change the solution of a node."""

    leave: Floats  # [n] that a row leaves its choice
    enter: Floats  # [m] that a row enters a column


@part
def twice_as_long(array: Any) -> Any:
    """A longer copy."""
    longer = np.empty((2 * array.shape[0], array.shape[1]), array.dtype)
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            longer[i, j] = array[i, j]
    return longer


@part
def ban(nodes: Ints, q: int, t: int, n: int, banned: Bools, on: bool) -> bool:
    """Forbid the pairs of child ``t`` of node ``q``, or undo that; True if staying unmatched is forbidden."""
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


@part
def lower_bounds(
    q: int, piece: Block, hub_banned: bool, nodes: Nodes, slacks: Slacks
) -> None:
    """Write lower bounds of what it costs that a row of node ``q`` leaves its choice.

    The path leaves the row by one pair and enters its column by another, or either way through the hub.
    """
    n = piece.n
    pair_local = piece.column
    table = nodes.table
    potentials = nodes.potentials
    enter = slacks.enter
    depth = table[q, 2 * n]
    for y in range(piece.m):
        enter[y] = -potentials[q, n + y]
    for t in range(depth, n):
        x = table[q, n + t]
        ux = potentials[q, x]
        own = table[q, x]
        least = -ux if own >= 0 and not (t == depth and hub_banned) else np.inf
        for e in range(piece.first[x], piece.last[x]):
            if e != own:
                y = pair_local[e]
                slack = piece.cost[e] - ux - potentials[q, n + y]
                enter[y] = min(enter[y], slack)
                if slack < least and not (t == depth and piece.banned[e]):
                    least = slack
        slacks.leave[x] = least
    for t in range(depth, n):
        x = table[q, n + t]
        if table[q, x] >= 0:
            slacks.leave[x] += max(enter[pair_local[table[q, x]]], 0.0)


@part
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


@part
def load_child(q: int, t: int, piece: Block, nodes: Nodes, matching: Matching) -> None:
    """Solution and potentials of node ``q``, with its first ``t`` rows and their columns out."""
    match, owner, u, v, row_out, column_out = matching
    n = piece.n
    pair_local = piece.column
    table = nodes.table
    potentials = nodes.potentials
    for y in range(piece.m):
        v[y] = potentials[q, n + y]
        owner[y] = HUB
        column_out[y] = False
    for x in range(n):
        match[x] = table[q, x]
        u[x] = potentials[q, x]
        row_out[x] = False
        if match[x] >= 0:
            owner[pair_local[match[x]]] = x
    for i in range(t):
        x = table[q, n + i]
        row_out[x] = True
        if match[x] >= 0:
            column_out[pair_local[match[x]]] = True


@part
def save_child(
    q: int,
    t: int,
    new: int,
    piece: Block,
    nodes: Nodes,
    matching: Matching,
    cost: float,
) -> None:
    """Write child ``t`` of node ``q`` as node ``new``; its rows after number ``t`` in any order."""
    n = piece.n
    m = piece.m
    table = nodes.table
    potentials = nodes.potentials
    for x in range(n):
        table[new, x], table[new, n + x], potentials[new, x] = (
            matching.match[x],
            table[q, n + x],
            matching.u[x],
        )
    for y in range(m):
        potentials[new, n + y] = matching.v[y]
    table[new, 2 * n], table[new, 2 * n + 1], potentials[new, n + m] = t, q, cost


@part
def split_node(
    q: int,
    piece: Block,
    nodes: Nodes,
    slacks: Slacks,
    spare: float,
    key: float,
    queue: SearchQueue,
    entries: int,
    size: int,
) -> tuple[int, int]:
    """Queue the children of node ``q`` that can matter, with their lower bounds; new numbers of entries and keys.

    ``spare``: by how much they may be dearer than the node's solution, which costs ``key``.
    ``slacks`` [n] and [m] is workspace; ``entries`` and ``size``: entries of the queue so far, and keys of its heap.
    """
    n = piece.n
    table = nodes.table
    depth = table[q, 2 * n]
    is_root = table[q, 2 * n + 1] < 0
    hub_banned = False
    if not is_root:
        hub_banned = ban(table, q, depth, n, piece.banned, True)
    lower_bounds(q, piece, hub_banned, nodes, slacks)
    if not is_root:
        ban(table, q, depth, n, piece.banned, False)
    split = sort_rows(q, n, table, slacks.leave, spare)
    for t in range(depth, n):
        lower = slacks.leave[table[q, n + t]]
        if (
            (t >= split or (t == depth and not is_root))
            and lower <= spare
            and lower < np.inf
        ):
            queue.node[entries], queue.child[entries] = q, t
            size = push(queue.keys, queue.names, size, key + max(lower, 0.0), entries)
            entries += 1
    return entries, size


@part
def solve_child(
    q: int,
    t: int,
    spare: float,
    piece: Block,
    nodes: Nodes,
    matching: Matching,
    path: Path,
) -> bool:
    """True if child ``t`` of node ``q`` has a solution dearer by at most ``spare``, written to the matching."""
    n = piece.n
    pair_local = piece.column
    load_child(q, t, piece, nodes, matching)
    source = nodes.table[q, n + t]
    target = HUB
    if matching.match[source] >= 0:
        target = pair_local[matching.match[source]]
        matching.owner[target] = HUB
    hub_banned = ban(nodes.table, q, t, n, piece.banned, True)
    length, far = find_path(source, target, spare, hub_banned, piece, matching, path)
    ban(nodes.table, q, t, n, piece.banned, False)
    if length < np.inf:
        change_potentials(source, length, far, piece, matching, path)
        flip_path(source, target, pair_local, matching, path)
    forget_path(path)
    return bool(length < np.inf)


@part
def search_solutions(
    piece: Block,
    root_cost: float,
    bound: Bound,
    matching: Matching,
    path: Path,
    kept: Kept,
) -> int:
    """As `enumeration.enumerate_solutions`, for pieces of any size; ``matching``: the cheapest solution."""
    n = piece.n
    m = piece.m
    k = len(kept.order)
    nodes = Nodes(np.empty((16, 2 * n + 2), np.int64), np.empty((16, n + m + 1)))
    slacks = Slacks(np.empty(n), np.empty(m))
    most = 2 * k * n + 2
    queue = SearchQueue(
        np.empty(most),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
    )
    for x in range(n):
        nodes.table[0, n + x] = x
    save_child(0, 0, 0, piece, nodes, matching, root_cost)
    nodes.table[0, 2 * n + 1] = -1
    queue.node[0], queue.child[0], queue.keys[0], queue.names[0] = 0, -1, root_cost, 0
    used = 1
    entries = 1
    size = 1
    count = 0
    while size > 0 and count < k:
        size = pop(queue.keys, queue.names, size)
        key = queue.keys[size]
        entry = queue.names[size]
        limit = limit_of(bound)
        q = queue.node[entry]
        t = queue.child[entry]
        spare = limit - (key - root_cost)
        if spare < 0.0:
            break
        if t < 0:
            kept.order[count], kept.cost[count] = count, nodes.potentials[q, n + m]
            for x in range(n):
                kept.pairs[kept.at + count * n + x] = nodes.table[q, x]
            count += 1
            if count < k:
                entries, size = split_node(
                    q, piece, nodes, slacks, spare, key, queue, entries, size
                )
            continue
        if not solve_child(
            q,
            t,
            limit - (nodes.potentials[q, n + m] - root_cost),
            piece,
            nodes,
            matching,
            path,
        ):
            continue
        if used == len(nodes.table):
            nodes = Nodes(twice_as_long(nodes.table), twice_as_long(nodes.potentials))
        cost = cost_of(matching.match, piece.cost, n)
        save_child(q, t, used, piece, nodes, matching, cost)
        note(bound.best, bound.totals, bound.size, cost - root_cost)
        queue.node[entries], queue.child[entries] = used, -1
        size = push(queue.keys, queue.names, size, max(cost, key), entries)
        used += 1
        entries += 1
    for x in range(n):
        matching.row_out[x] = False
    for y in range(m):
        matching.column_out[y] = False
    return count
