"""The cheapest solutions of a small piece, by depth-first search with reduced costs as lower bounds."""

from ...core import Floats, Ints
from .compile import inlined, part
from .tables import Block, Bound, Choices, Kept, Matching


@inlined
def limit_of(bound: Bound) -> float:
    """Largest gap to its cheapest solution at which a solution of the piece can matter."""
    return float(bound.best[-1] - bound.totals[0] + bound.slack)


@inlined
def note(best: Floats, totals: Floats, size: int, gap: float) -> None:
    """Enter the totals of all parents of a piece with a solution dearer by ``gap`` among the least known, ``best`` [k].

    ``totals``: of the parents' cheapest solutions, increasing; ``size``: how many those are.
    """
    for i in range(size):
        total = totals[i] + gap
        j = len(best) - 1
        if total >= best[j]:
            break
        while j > 0 and best[j - 1] > total:
            best[j] = best[j - 1]
            j -= 1
        best[j] = total


@inlined
def keep(total: float, count: int, piece: Block, option: Ints, kept: Kept) -> int:
    """Enter the present choice, which costs ``total``, as a new solution or for the dearest; returns their number."""
    order = kept.order
    cost = kept.cost
    k = len(kept.order)
    place = order[k - 1] if count == k else count
    count += 1 if count < k else 0
    cost[place] = total
    for a in range(piece.n):
        kept.pairs[kept.at + place * piece.n + a] = (
            option[a] if option[a] < piece.last[a] else -1
        )
    i = count - 1
    while i > 0 and cost[order[i - 1]] > total:
        order[i] = order[i - 1]
        i -= 1
    order[i] = place
    return count


@inlined
def is_matching(piece: Block, option: Ints, match: Ints) -> bool:
    """True if the present choice is this matching."""
    same = True
    for a in range(piece.n):
        same &= match[a] == (option[a] if option[a] < piece.last[a] else -1)
    return same


@part
def enumerate_solutions(
    piece: Block,
    matching: Matching,
    root_cost: float,
    bound: Bound,
    choice: Choices,
    kept: Kept,
    patience: int,
) -> int:
    """Number of solutions kept, at most k: all of the piece that can be among the k cheapest of the whole problem.

    -1, with ``bound.best`` spoilt, if more than ``patience`` partial choices would have to be looked at.
    ``matching``: the cheapest solution, which costs ``root_cost``, and its potentials; zeros if it is not known.
    """
    first = piece.first
    last = piece.last
    column = piece.column
    cost = piece.cost
    u = matching.u
    v = matching.v
    taken, option, lower, total = choice
    n = piece.n
    k = len(kept.order)
    count = 0
    x = 0
    lower[0] = 0.0
    total[0] = 0.0
    option[0] = first[0] - 1
    limit = limit_of(bound)
    while x >= 0:
        e = option[x]
        if first[x] <= e < last[x]:
            taken[column[e]] = False
        e += 1
        while e < last[x] and (
            taken[column[e]] or lower[x] + cost[e] - u[x] - v[column[e]] > limit
        ):
            e += 1
        option[x] = e
        if e > last[x] or (e == last[x] and lower[x] - u[x] > limit):
            x -= 1
            continue
        if e < last[x]:
            taken[column[e]] = True
            lower[x + 1] = lower[x] + cost[e] - u[x] - v[column[e]]
            total[x + 1] = total[x] + cost[e]
        else:
            lower[x + 1] = lower[x] - u[x]
            total[x + 1] = total[x]
        patience -= 1
        if patience < 0:
            for y in range(piece.m):
                taken[y] = False
            count = -1
            break
        x += 1
        if x < n:
            option[x] = first[x] - 1
            continue
        x -= 1
        gap = total[n] - root_cost
        if gap > limit or (count == k and total[n] >= kept.cost[kept.order[k - 1]]):
            continue
        count = keep(total[n], count, piece, option, kept)
        if bound.size > 0 and not is_matching(piece, option, matching.match):
            note(bound.best, bound.totals, bound.size, gap)
            limit = limit_of(bound)
    return count
