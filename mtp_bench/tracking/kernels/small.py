"""All solutions of a small piece that can matter, by depth-first enumeration with reduced costs as lower bounds."""

from __future__ import annotations

from ...types import Floats, Ints
from .bounds import note
from .compile import kernel
from .tables import Bound, Choices, Kept, Matching, Piece


@kernel
def choices(q: int, begin: Ints, places: Ints, pair_start: Ints, most: int) -> int:
    """Product of the choices of the rows of piece ``q``, at most ``most`` + 1."""
    product = 1
    for i in range(begin[q], begin[q + 1]):
        product *= pair_start[places[i] + 1] - pair_start[places[i]] + 1
        if product > most:
            return most + 1
    return product  # pyright: ignore[reportReturnType]


@kernel(inline=True)
def keep(total: float, count: int, piece: Piece, option: Ints, kept: Kept) -> int:
    """Enter the present choice, which costs ``total``, as a new solution or for the dearest; how many there are."""
    order = kept.order
    place = count
    if count == kept.k:
        place = order[kept.k - 1]
    else:
        count += 1
    kept.cost[place] = total
    for a in range(piece.n):
        kept.pairs[kept.at + place * piece.n + a] = option[a] if option[a] < piece.last[a] else -1
    i = count - 1
    while i > 0 and kept.cost[order[i - 1]] > total:
        order[i] = order[i - 1]
        i -= 1
    order[i] = place
    return count


@kernel(inline=True)
def is_root(piece: Piece, option: Ints, root: Ints) -> bool:
    """Whether the present choice is the solution ``root``."""
    same = True
    for a in range(piece.n):
        same &= root[a] == (option[a] if option[a] < piece.last[a] else -1)
    return same


@kernel
def enumerate_solutions(
    piece: Piece, matching: Matching, root_cost: float, bound: Bound, choice: Choices, kept: Kept, patience: int
) -> int:
    """How many solutions of a piece were found, at most k: all that can be among the k cheapest of the whole problem.

    -1, with ``bound.best`` spoilt, if more than ``patience`` partial choices would have to be looked at.
    ``matching`` holds the cheapest solution, which costs ``root_cost``, and its potentials. The solutions are ``kept``.
    """
    first, last, pair_local, pair_cost = piece.first, piece.last, piece.column, piece.cost
    u, v = matching.u, matching.v
    taken, option, lower, total = choice
    n, count, x = piece.n, 0, 0
    lower[0], total[0] = 0.0, 0.0
    option[0] = first[0] - 1
    limit = bound.best[kept.k - 1] - bound.roots[bound.low] + bound.slack
    while x >= 0:
        e = option[x]
        if first[x] <= e < last[x]:
            taken[pair_local[e]] = False
        e += 1
        while e < last[x] and (taken[pair_local[e]] or lower[x] + pair_cost[e] - u[x] - v[pair_local[e]] > limit):
            e += 1
        option[x] = e
        if e > last[x] or (e == last[x] and lower[x] - u[x] > limit):
            x -= 1
            continue
        if e < last[x]:
            taken[pair_local[e]] = True
            lower[x + 1] = lower[x] + pair_cost[e] - u[x] - v[pair_local[e]]
            total[x + 1] = total[x] + pair_cost[e]
        else:
            lower[x + 1], total[x + 1] = lower[x] - u[x], total[x]
        patience -= 1
        if patience < 0:
            for a in range(x + 1):
                if option[a] < last[a]:
                    taken[pair_local[option[a]]] = False
            return -1
        x += 1
        if x < n:
            option[x] = first[x] - 1
            continue
        x -= 1
        gap = total[n] - root_cost
        if gap > limit or (count == kept.k and total[n] >= kept.cost[kept.order[kept.k - 1]]):
            continue
        count = keep(total[n], count, piece, option, kept)
        if not is_root(piece, option, matching.match):
            note(bound.best, bound.roots, bound.low, bound.high, gap)
            limit = bound.best[kept.k - 1] - bound.roots[bound.low] + bound.slack
    return count


@kernel(inline=True)
def enumerate_all(piece: Piece, choice: Choices, kept: Kept) -> int:
    """As `enumerate_solutions`, for a piece so small that a bound does not pay: all solutions, at most the k best."""
    first, last, column = piece.first, piece.last, piece.column
    taken, option, total = choice.taken, choice.option, choice.total
    count, x = 0 * piece.n, 0
    total[0] = 0.0
    option[0] = first[0] - 1
    while x >= 0:
        e = option[x]
        if first[x] <= e < last[x]:
            taken[column[e]] = False
        e += 1
        while e < last[x] and taken[column[e]]:
            e += 1
        option[x] = e
        if e > last[x]:
            x -= 1
            continue
        cost = total[x]
        if e < last[x]:
            cost += piece.cost[e]
        if x < piece.n - 1:
            if e < last[x]:
                taken[column[e]] = True
            x += 1
            total[x], option[x] = cost, first[x] - 1
        elif count < kept.k or cost < kept.cost[kept.order[kept.k - 1]]:
            count = keep(cost, count, piece, option, kept)
    return count


@kernel
def single_row_root(first: int, last: int, pair_cost: Floats) -> int:
    """Cheapest choice of one row; -1 for none."""
    least, chosen = 0.0, -1
    for e in range(first, last):
        if pair_cost[e] < least:
            least, chosen = pair_cost[e], e
    return chosen
