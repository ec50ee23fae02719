"""One shortest alternating path over reduced costs, and what it changes (Jonker and Volgenant 1987).

Rows take a column or stay unmatched at cost 0, columns may stay unmatched at cost 0. The square extension of such a
problem has a dummy of its own for every row and column and a block of zeros between the dummies. All dummies can reach
each other at cost 0: here they are **one node**, the hub, with potential 0, so that nothing is inflated and no solution
is written in two ways.

Potentials ``u`` <= 0 of rows and ``v`` <= 0 of columns: cost - u - v >= 0 for every pair, = 0 for chosen ones; u = 0
for unmatched rows, v = 0 for unmatched columns. A row goes to the hub (becomes unmatched) at -u, the hub goes to a
column (which becomes unmatched) at -v, a column that is unmatched goes to the hub at 0, as the hub does to an unmatched
row.
"""

import numpy as np

from ...core import Floats, Ints
from .compile import part
from .tables import Block, Matching, Path

HUB = -1  # as a source or target, and what an unmatched row or column has


@part
def find_path(  # noqa: C901, PLR0912, PLR0915 - the hot loop, in one piece: no call per row or column
    source: int,
    target: int,
    limit: float,
    hub_banned: bool,
    piece: Block,
    matching: Matching,
    path: Path,
) -> tuple[float, float]:
    """Length of the shortest path from a row (or the hub) to a column (or the hub), and the distance of the hub.

    Infinite if there is no path of at most ``limit``. The source row may not use pairs that are ``banned`` nor, if
    ``hub_banned``, the hub. Rows and columns that are out do not take part. Fills ``path``, whose distances are
    infinite at the start.
    """
    first = piece.first
    last = piece.last
    pair_local = piece.column
    pair_cost = piece.cost
    banned = piece.banned
    match, owner, u, v, row_out, column_out = matching
    dist, through, by, seen, hub = path
    count = 0
    closed = 0
    far = np.inf
    hub_open = True
    hub[0], hub[1] = -1, -1
    d = 0.0
    low = source
    high = source + 1
    from_hub = False
    if source == HUB:
        far = 0.0
        low = 0
        high = 0
    while True:
        for x in range(low, high):
            if from_hub and (match[x] >= 0 or row_out[x] or x == source):
                continue  # unmatched rows only
            ux = u[x]
            for e in range(first[x], last[x]):
                y = pair_local[e]
                if column_out[y] or (x == source and banned[e]):
                    continue
                # Never below 0, or rounding would improve what is closed already.
                at = d + max(pair_cost[e] - ux - v[y], 0.0)
                if at < dist[y] and at <= limit:
                    if dist[y] == np.inf:
                        seen[count] = y
                        count += 1
                    dist[y] = at
                    through[y] = e
                    by[y] = x
                    if y == target:
                        limit = at  # what lies beyond is of no interest
                    elif owner[y] == HUB and hub_open and at < far:
                        far, hub[0], hub[1] = at, -1, y
                        if target == HUB:
                            limit = at
            if (
                hub_open
                and not (x == source and hub_banned)
                and d - ux < far
                and d - ux <= limit
            ):
                far = max(d - ux, d)
                hub[0], hub[1] = x, -1
                if target == HUB:
                    limit = far
        best = far if hub_open else np.inf
        at_best = -1
        for i in range(closed, count):
            if dist[seen[i]] < best:
                best = dist[seen[i]]
                at_best = i
        hub[2] = count
        if best == np.inf or (dist[target] <= best if target >= 0 else far <= best):
            return float(best), float(far)
        d = best
        from_hub = at_best < 0
        if at_best >= 0:
            y = seen[at_best]
            seen[at_best], seen[closed] = seen[closed], y
            closed += 1
            low, high = (0, 0) if owner[y] == HUB else (owner[y], owner[y] + 1)
            continue
        hub_open = False
        for y in range(piece.m):
            at = d + max(-v[y], 0.0)
            if not column_out[y] and at < dist[y] and at <= limit:
                if dist[y] == np.inf:
                    seen[count] = y
                    count += 1
                dist[y] = at
                through[y] = -1
                by[y] = -1
                if y == target:
                    limit = at
        low = 0
        high = piece.n


@part
def forget_path(path: Path) -> None:
    """Reset the distances of the columns that a search reached to infinity."""
    for i in range(path.hub[2]):
        path.dist[path.seen[i]] = np.inf


@part
def change_potentials(
    source: int, length: float, far: float, piece: Block, matching: Matching, path: Path
) -> None:
    """Change the potentials to those of the matching after `flip_path`; call it before that."""
    match, owner, u, v, row_out, column_out = matching
    lift = max(
        length - far, 0.0
    )  # of the hub, whose potential stays 0: the others move instead
    if lift > 0.0:
        for x in range(piece.n):
            if not row_out[x] and (match[x] >= 0 or x == source):
                u[x] -= lift
        for y in range(piece.m):
            if not column_out[y]:
                v[y] += lift
    for i in range(path.hub[2]):
        y = path.seen[i]
        if path.dist[y] < length:
            v[y] -= length - path.dist[y]
            if owner[y] >= 0:
                u[owner[y]] += length - path.dist[y]
    if source != HUB:
        u[source] += length


@part
def flip_path(
    source: int, target: int, column: Ints, matching: Matching, path: Path
) -> None:
    """Change the matching along the path found; ``column`` [E]: the column of each pair."""
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
            x = path.by[y]
            e = path.through[y]
            matching.owner[y] = x
            if e < 0:
                y = HUB
                continue
        old = matching.match[x]
        matching.match[x] = e
        if x == source:
            return
        y = column[old] if old >= 0 else HUB


@part
def start_greedily(piece: Block, matching: Matching) -> int:
    """Give every row its cheapest choice; return the number of rows left out because their column is taken."""
    match, owner, u, v, row_out, _ = matching
    waiting = 0
    for y in range(piece.m):
        v[y] = 0.0
        owner[y] = HUB
    for x in range(piece.n):
        least = 0.0
        chosen = -1
        for e in range(piece.first[x], piece.last[x]):
            if piece.cost[e] < least:
                least = piece.cost[e]
                chosen = e
        u[x] = least
        if chosen >= 0:
            if owner[piece.column[chosen]] >= 0:
                chosen = -1
                row_out[x] = True
                waiting += 1
            else:
                owner[piece.column[chosen]] = x
        match[x] = chosen
    return waiting


@part
def solve_root(piece: Block, matching: Matching, path: Path) -> None:
    """The cheapest solution and its potentials: a greedy start, then a shortest path for each row that is left out."""
    if start_greedily(piece, matching) == 0:
        return
    for x in range(piece.n):
        if not matching.row_out[x]:
            continue
        matching.row_out[x] = False
        least = 0.0
        for e in range(piece.first[x], piece.last[x]):
            least = min(least, piece.cost[e] - matching.v[piece.column[e]])
        matching.u[x] = least
        length, far = find_path(x, HUB, np.inf, False, piece, matching, path)
        change_potentials(x, length, far, piece, matching, path)
        flip_path(x, HUB, piece.column, matching, path)
        forget_path(path)


@part
def cost_of(match: Ints, pair_cost: Floats, n: int) -> float:
    """Cost of a matching, summed in the order of the rows."""
    total = 0.0
    for x in range(n):
        if match[x] >= 0:
            total += pair_cost[match[x]]
    return float(total)
