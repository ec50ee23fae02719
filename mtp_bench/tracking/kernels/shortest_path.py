"""One shortest alternating path over reduced costs, and what it changes.

Rows take a column or stay unmatched at cost 0, columns may stay unmatched at cost 0.
The square extension of such a problem has a dummy of its own for every row and column
and a block of zeros between the dummies. All dummies can reach each other at cost 0:
here they are **one node**, the hub, with potential 0, so that nothing is inflated and
no solution is written in two ways.

Potentials ``u`` <= 0 of rows and ``v`` <= 0 of columns: cost - u - v >= 0 for every
pair, = 0 for chosen ones; u = 0 for unmatched rows, v = 0 for unmatched columns. A row
goes to the hub (becomes unmatched) at -u, the hub goes to a column (which becomes
unmatched) at -v, a column that is unmatched goes to the hub at 0, as the hub does to an
unmatched row.

Source: Jonker and Volgenant 1987.
"""

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, part
from .tables import Block, Matching, Path

HUB = -1  # as a source or target, and what an unmatched row or column has


@inlined
def reach_column(y: int, length: float, e: int, x: int, path: Path) -> None:
    """Enter a shorter path to column ``y``.

    It comes by pair ``e`` of row ``x``.
    """
    if path.distance[y] == np.inf:
        path.reached[path.hub[2]] = y
        path.hub[2] += 1
    path.distance[y] = length
    path.via_pair[y] = e
    path.via_row[y] = x


@inlined
def scan_row(
    x: int,
    d: float,
    source: int,
    target: int,
    limit: float,
    hub_distance: float,
    piece: Block,
    matching: Matching,
    path: Path,
) -> tuple[float, float]:
    """Reach the columns of row ``x``, which is at distance ``d``.

    Returns the limit and the distance of the hub.
    """
    column = piece.pair_column
    cost = piece.pair_cost
    v = matching.v
    distance = path.distance
    ux = matching.u[x]
    for e in range(piece.pair_start[x], piece.pair_end[x]):
        y = column[e]
        if matching.column_out[y] or (x == source and piece.banned[e]):
            continue
        # Never below 0, or rounding would improve what is closed already.
        length = d + max(cost[e] - ux - v[y], 0.0)
        if length >= distance[y] or length > limit:
            continue
        reach_column(y, length, e, x, path)
        if y == target:
            limit = length  # what lies beyond is of no interest
        elif matching.owner[y] == HUB and length < hub_distance:
            hub_distance = length
            path.hub[0] = -1
            path.hub[1] = y
    return limit, hub_distance


@inlined
def reach_hub(
    x: int, length: float, d: float, limit: float, hub_distance: float, hub: Ints
) -> float:
    """Reach the hub from row ``x`` and return its distance.

    The row is at distance ``d``, the hub by it at ``length``.
    """
    if length < hub_distance and length <= limit:
        hub_distance = max(length, d)
        hub[0] = x
        hub[1] = -1
    return hub_distance


@inlined
def scan_columns(
    d: float, target: int, limit: float, piece: Block, matching: Matching, path: Path
) -> float:
    """Reach all columns from the hub and return the limit.

    The hub is at distance ``d``.
    """
    for y in range(piece.m):
        length = d + max(-matching.v[y], 0.0)
        if not matching.column_out[y] and length < path.distance[y] and length <= limit:
            reach_column(y, length, -1, -1, path)
            if y == target:
                limit = length
    return limit


@inlined
def nearest_open(closed: int, max_distance: float, path: Path) -> tuple[int, float]:
    """Find the nearest column that is not closed, and its distance.

    It is an index of the columns reached, the first of equals; -1 and ``max_distance``
    if none is nearer than that.
    """
    distance = path.distance
    reached = path.reached
    nearest = -1
    for i in range(closed, path.hub[2]):
        if distance[reached[i]] < max_distance:
            max_distance = distance[reached[i]]
            nearest = i
    return nearest, max_distance


@part
def leads_to(x: int, source: int, match: Ints, row_out: Bools) -> bool:
    """Return whether the hub leads to row ``x``: an unmatched one."""
    return bool(match[x] < 0 and not row_out[x] and x != source)


@part
def find_path(
    source: int,
    target: int,
    limit: float,
    hub_banned: bool,
    piece: Block,
    matching: Matching,
    path: Path,
) -> tuple[float, float]:
    """Find the shortest path from source to target.

    The source is a row or the hub, the target a column or the hub. Returns the length,
    infinite if there is no path of at most ``limit``, and the distance of the hub. The
    source row may not use pairs that are ``banned`` nor, if ``hub_banned``, the hub.
    Rows and columns that are out do not take part. Fills ``path``, whose distances are
    infinite at the start.
    """
    match = matching.match
    owner = matching.owner
    row_out = matching.row_out
    distance = path.distance
    reached = path.reached
    hub = path.hub
    hub[0] = -1
    hub[1] = -1
    hub[2] = 0
    hub_open = True
    hub_distance = 0.0 if source == HUB else np.inf
    closed = 0
    d = 0.0
    # the rows to look at next: one, or from the hub all unmatched ones
    from_hub = False
    first_row = max(source, 0)
    end_row = source + 1
    while True:
        for x in range(first_row, end_row):
            if from_hub and not leads_to(x, source, match, row_out):
                continue
            limit, hub_distance = scan_row(
                x, d, source, target, limit, hub_distance, piece, matching, path
            )
            if hub_open and not (x == source and hub_banned):
                length = d - matching.u[x]
                hub_distance = reach_hub(x, length, d, limit, hub_distance, hub)
            if target == HUB:
                limit = min(limit, hub_distance)
        nearest, best = nearest_open(closed, hub_distance if hub_open else np.inf, path)
        target_distance = hub_distance if target == HUB else distance[target]
        if best == np.inf or target_distance <= best:
            return float(best), float(hub_distance)
        d = best
        from_hub = nearest < 0
        if from_hub:
            hub_open = False
            limit = scan_columns(d, target, limit, piece, matching, path)
            first_row = 0
            end_row = piece.n
        else:
            y = reached[nearest]
            reached[nearest] = reached[closed]
            reached[closed] = y
            closed += 1
            first_row = max(owner[y], 0)
            end_row = owner[y] + 1


@part
def forget_path(path: Path) -> None:
    """Reset the distances that a search changed to infinity."""
    for i in range(path.hub[2]):
        path.distance[path.reached[i]] = np.inf


@part
def lift_hub(lift: float, source: int, piece: Block, matching: Matching) -> None:
    """Lift the hub: its potential stays 0, the others move."""
    match, _, u, v, row_out, column_out = matching
    for x in range(piece.n):
        if not row_out[x] and (match[x] >= 0 or x == source):
            u[x] -= lift
    for y in range(piece.m):
        if not column_out[y]:
            v[y] += lift


@part
def change_potentials(
    source: int,
    length: float,
    hub_distance: float,
    piece: Block,
    matching: Matching,
    path: Path,
) -> None:
    """Change the potentials to those of the matching after `flip_path`.

    Call it before that.
    """
    owner = matching.owner
    u = matching.u
    v = matching.v
    if length > hub_distance:
        lift_hub(length - hub_distance, source, piece, matching)
    for i in range(path.hub[2]):
        y = path.reached[i]
        if path.distance[y] < length:
            v[y] -= length - path.distance[y]
            if owner[y] >= 0:
                u[owner[y]] += length - path.distance[y]
    if source != HUB:
        u[source] += length


@part
def flip_path(
    source: int, target: int, column: Ints, matching: Matching, path: Path
) -> None:
    """Change the matching along the path found.

    ``column`` [E]: of each pair.
    """
    y = target
    while True:
        if y == HUB:
            if path.hub[0] >= 0:
                x = path.hub[0]
                e = -1
            elif path.hub[1] >= 0:
                y = path.hub[1]
                continue
            else:
                return  # the hub is the source
        else:
            x = path.via_row[y]
            e = path.via_pair[y]
            matching.owner[y] = x
            if e < 0:
                y = HUB
                continue
        old_pair = matching.match[x]
        matching.match[x] = e
        if x == source:
            return
        y = column[old_pair] if old_pair >= 0 else HUB


@part
def start_greedily(piece: Block, matching: Matching) -> int:
    """Give every row its cheapest choice and count those left out.

    A row is left out because its column is taken.
    """
    match, owner, u, v, row_out, _ = matching
    rows_out = 0
    for y in range(piece.m):
        v[y] = 0.0
        owner[y] = HUB
    for x in range(piece.n):
        min_cost = 0.0
        chosen = -1
        for e in range(piece.pair_start[x], piece.pair_end[x]):
            if piece.pair_cost[e] < min_cost:
                min_cost = piece.pair_cost[e]
                chosen = e
        u[x] = min_cost
        if chosen >= 0:
            if owner[piece.pair_column[chosen]] >= 0:
                chosen = -1
                row_out[x] = True
                rows_out += 1
            else:
                owner[piece.pair_column[chosen]] = x
        match[x] = chosen
    return rows_out


@part
def solve_root(piece: Block, matching: Matching, path: Path) -> None:
    """Find the cheapest solution and its potentials.

    After a greedy start each row that was left out takes a shortest path.
    """
    if start_greedily(piece, matching) == 0:
        return
    for x in range(piece.n):
        if not matching.row_out[x]:
            continue
        matching.row_out[x] = False
        min_cost = 0.0
        for e in range(piece.pair_start[x], piece.pair_end[x]):
            reduced_cost = piece.pair_cost[e] - matching.v[piece.pair_column[e]]
            min_cost = min(min_cost, reduced_cost)
        matching.u[x] = min_cost
        length, hub_distance = find_path(x, HUB, np.inf, False, piece, matching, path)
        change_potentials(x, length, hub_distance, piece, matching, path)
        flip_path(x, HUB, piece.pair_column, matching, path)
        forget_path(path)


@part
def cost_of(match: Ints, pair_cost: Floats, n: int) -> float:
    """Sum the cost of a matching in row order."""
    total = 0.0
    for x in range(n):
        if match[x] >= 0:
            total += pair_cost[match[x]]
    return float(total)
