"""Murty's search (1968) for the k cheapest solutions of a piece.

A node is a solution and the part of all solutions that it is the cheapest of: its first
rows, in an order of its own, keep their choices, and the row after them may not take
some. What is left of the part without the solution itself is split into disjoint
children: child t keeps the first t rows and forbids the choice of the next. A child
starts with the matching and the potentials of its parent and needs one shortest
alternating path (Miller, Stone and Cox 1997). Rows come in descending slack (what
leaving their choice costs at least), so that the likely children have many rows fixed;
children wait in the queue with that lower bound and are solved only when nothing
cheaper is left (Motro and Ghosh 2019).
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
from .tables import Block, Bound, Matching, Path, Ranking


class Nodes(NamedTuple):
    """The nodes of the search, a row each."""

    # [.., 2 n + 2] the pair of each row; the order of the rows; number of fixed rows;
    # the node that it is a child of, -1: the root
    table: Ints
    # [.., n + m + 1] of rows; of columns; the cost of the solution
    potentials: Floats


class SearchQueue(NamedTuple):
    """Entries that wait: a solution of a node, or an unsolved child of it."""

    keys: Floats  # the heap of costs and lower bounds
    names: Ints  # entry of each key
    node: Ints  # by entry
    child: Ints  # by entry, number of the child; -1: the solution itself


class Slacks(NamedTuple):
    """Lower bounds of what it costs to change the solution of a node."""

    leave: Floats  # [n] that a row leaves its choice
    enter: Floats  # [m] that a row enters a column


@part
def twice_as_long(array: Any) -> Any:
    """Copy a table into the first half of a longer one."""
    longer = np.empty((2 * array.shape[0], array.shape[1]), array.dtype)
    longer[: array.shape[0]] = array
    return longer


@part
def ban(table: Ints, q: int, t: int, n: int, banned: Bools, value: bool) -> bool:
    """Forbid the pairs of a child, or undo that.

    It is child ``t`` of node ``q``. Returns whether staying unmatched is forbidden.
    """
    row = table[q, n + t]
    hub_banned = False
    while True:
        e = table[q, row]
        if e >= 0:
            banned[e] = value
        else:
            hub_banned = True
        origin = table[q, 2 * n + 1]
        if origin < 0 or table[q, 2 * n] != t:
            return hub_banned
        q = origin


@part
def lower_bounds(
    q: int, piece: Block, hub_banned: bool, nodes: Nodes, slacks: Slacks
) -> None:
    """Write lower bounds of the cost of leaving choices.

    The path leaves the row of node ``q`` by one pair and enters its column by another,
    or either way through the hub. Pairs of its first open row may be banned, and for
    this row the hub if ``hub_banned``.
    """
    n = piece.n
    column = piece.pair_column
    table = nodes.table
    potentials = nodes.potentials
    enter = slacks.enter
    depth = table[q, 2 * n]
    for y in range(piece.m):
        enter[y] = -potentials[q, n + y]
    for t in range(depth, n):
        x = table[q, n + t]
        ux = potentials[q, x]
        chosen = table[q, x]
        min_slack = np.inf
        if chosen >= 0 and not hub_banned:
            min_slack = -ux
        hub_banned = False  # of the rows that follow
        for e in range(piece.pair_start[x], piece.pair_end[x]):
            if e == chosen:
                continue
            y = column[e]
            slack = piece.pair_cost[e] - ux - potentials[q, n + y]
            enter[y] = min(enter[y], slack)
            if not piece.banned[e]:
                min_slack = min(min_slack, slack)
        slacks.leave[x] = min_slack
    for t in range(depth, n):
        x = table[q, n + t]
        if table[q, x] >= 0:
            slacks.leave[x] += max(enter[column[table[q, x]]], 0.0)


@part
def sort_rows(q: int, n: int, table: Ints, leave: Floats, max_rise: float) -> int:
    """Order a node's open rows by slack and return a limit.

    The limit is the first t whose child can matter, dearer by at most ``max_rise``.
    Slack descends. Rows that cannot matter come first in any order. The row that may
    not take some choices keeps its place before all.
    """
    low = table[q, 2 * n]
    if table[q, 2 * n + 1] >= 0:
        low += 1
    split = low
    for t in range(low, n):
        x = table[q, n + t]
        if leave[x] > max_rise:
            table[q, n + t] = table[q, n + split]
            table[q, n + split] = x
            split += 1
    for t in range(split + 1, n):
        x = table[q, n + t]
        i = t
        while i > split and leave[table[q, n + i - 1]] < leave[x]:
            table[q, n + i] = table[q, n + i - 1]
            i -= 1
        table[q, n + i] = x
    return int(split)


@part
def load_child(q: int, t: int, piece: Block, nodes: Nodes, matching: Matching) -> None:
    """Read solution and potentials of node ``q`` into the matching.

    Its first ``t`` rows and their columns are out.
    """
    match, owner, u, v, row_out, column_out = matching
    n = piece.n
    column = piece.pair_column
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
            owner[column[match[x]]] = x
    for i in range(t):
        x = table[q, n + i]
        row_out[x] = True
        if match[x] >= 0:
            column_out[column[match[x]]] = True


@part
def save_child(
    q: int,
    t: int,
    child: int,
    piece: Block,
    nodes: Nodes,
    matching: Matching,
    cost: float,
) -> None:
    """Write child ``t`` of node ``q`` as node ``child``.

    Its rows after number ``t`` come in any order.
    """
    n = piece.n
    m = piece.m
    table = nodes.table
    potentials = nodes.potentials
    for x in range(n):
        table[child, x] = matching.match[x]
        table[child, n + x] = table[q, n + x]
        potentials[child, x] = matching.u[x]
    for y in range(m):
        potentials[child, n + y] = matching.v[y]
    table[child, 2 * n] = t
    table[child, 2 * n + 1] = q
    potentials[child, n + m] = cost


@part
def split_node(
    q: int,
    piece: Block,
    nodes: Nodes,
    slacks: Slacks,
    max_rise: float,
    key: float,
    queue: SearchQueue,
    entries: int,
    size: int,
) -> tuple[int, int]:
    """Queue the children of a node that can matter.

    ``max_rise``: by how much they may be dearer than the node's solution, which costs
    ``key``. ``slacks`` [n] and [m] is workspace; ``entries`` and ``size``: entries of
    the queue so far, and keys of its heap. Returns the new numbers of both.
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
    split = sort_rows(q, n, table, slacks.leave, max_rise)
    for t in range(depth, n):
        if t < split and (t > depth or is_root):
            continue
        rise = slacks.leave[table[q, n + t]]
        if rise <= max_rise and rise < np.inf:
            queue.node[entries] = q
            queue.child[entries] = t
            size = push(queue.keys, queue.names, size, key + max(rise, 0.0), entries)
            entries += 1
    return entries, size


@part
def solve_child(
    q: int,
    t: int,
    max_rise: float,
    piece: Block,
    nodes: Nodes,
    matching: Matching,
    path: Path,
) -> bool:
    """Find a child's solution and return whether it can matter.

    It is child ``t`` of node ``q``. The solution is written to the matching if it is
    dearer by at most ``max_rise``.
    """
    n = piece.n
    column = piece.pair_column
    load_child(q, t, piece, nodes, matching)
    source = nodes.table[q, n + t]
    target = HUB
    if matching.match[source] >= 0:
        target = column[matching.match[source]]
        matching.owner[target] = HUB
    hub_banned = ban(nodes.table, q, t, n, piece.banned, True)
    length, hub_distance = find_path(
        source, target, max_rise, hub_banned, piece, matching, path
    )
    ban(nodes.table, q, t, n, piece.banned, False)
    if length < np.inf:
        change_potentials(source, length, hub_distance, piece, matching, path)
        flip_path(source, target, column, matching, path)
    forget_path(path)
    return bool(length < np.inf)


@part
def new_nodes(piece: Block, matching: Matching, root_cost: float) -> Nodes:
    """Make room for nodes, the first of them the root."""
    n = piece.n
    table = np.empty((16, 2 * n + 2), np.int64)
    for x in range(n):
        table[0, n + x] = x
    nodes = Nodes(table, np.empty((16, n + piece.m + 1)))
    save_child(0, 0, 0, piece, nodes, matching, root_cost)
    table[0, 2 * n + 1] = -1
    return nodes


@part
def rank_node(q: int, count: int, piece: Block, nodes: Nodes, ranking: Ranking) -> None:
    """Append the solution of a node to a ranking of ``count``."""
    n = piece.n
    ranking.order[count] = count
    ranking.cost[count] = nodes.potentials[q, n + piece.m]
    for x in range(n):
        ranking.pairs[ranking.start + count * n + x] = nodes.table[q, x]


@part
def search_solutions(
    piece: Block,
    root_cost: float,
    bound: Bound,
    matching: Matching,
    path: Path,
    ranking: Ranking,
) -> int:
    """Rank solutions as `enumeration.enumerate_solutions`, for pieces of any size.

    ``matching``: the cheapest solution, which costs ``root_cost``.
    """
    n = piece.n
    m = piece.m
    k = len(ranking.order)
    nodes = new_nodes(piece, matching, root_cost)
    slacks = Slacks(np.empty(n), np.empty(m))
    max_entries = 2 * k * n + 2
    numbers = np.empty((3, max_entries), np.int64)
    queue = SearchQueue(np.empty(max_entries), numbers[0], numbers[1], numbers[2])
    queue.node[0] = 0
    queue.child[0] = -1
    size = push(queue.keys, queue.names, 0, root_cost, 0)
    entries = 1
    node_count = 1
    count = 0
    while size > 0 and count < k:
        size = pop(queue.keys, queue.names, size)
        key = queue.keys[size]
        entry = queue.names[size]
        limit = limit_of(bound)
        q = queue.node[entry]
        t = queue.child[entry]
        max_rise = limit - (key - root_cost)
        if max_rise < 0.0:
            break
        if t < 0:
            rank_node(q, count, piece, nodes, ranking)
            count += 1
            if count < k:
                entries, size = split_node(
                    q, piece, nodes, slacks, max_rise, key, queue, entries, size
                )
            continue
        max_rise = limit - (nodes.potentials[q, n + m] - root_cost)
        if not solve_child(q, t, max_rise, piece, nodes, matching, path):
            continue
        if node_count == len(nodes.table):
            nodes = Nodes(twice_as_long(nodes.table), twice_as_long(nodes.potentials))
        cost = cost_of(matching.match, piece.pair_cost, n)
        save_child(q, t, node_count, piece, nodes, matching, cost)
        note(bound.best, bound.totals, bound.parent_count, cost - root_cost)
        queue.node[entries] = node_count
        queue.child[entries] = -1
        size = push(queue.keys, queue.names, size, max(cost, key), entries)
        node_count += 1
        entries += 1
    matching.row_out[:n] = False
    matching.column_out[:m] = False
    return count
