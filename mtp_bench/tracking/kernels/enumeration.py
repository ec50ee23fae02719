"""The cheapest solutions of a small piece, by depth-first search.

Reduced costs are its lower bounds.
"""

from ...core import Floats, Ints
from .compile import inlined, part
from .tables import Block, Bound, Choices, Matching, Ranking


@inlined
def limit_of(bound: Bound) -> float:
    """Return the largest gap at which a solution can matter."""
    return float(bound.best[-1] - bound.totals[0] + bound.slack)


@inlined
def note(best: Floats, totals: Floats, parent_count: int, gap: float) -> None:
    """Enter the totals of a solution among the least known.

    Those are ``best`` [k]. The solution is dearer by ``gap`` than the cheapest of its
    piece. ``totals``: of the cheapest solutions of the ``parent_count`` parents of the
    piece, increasing.
    """
    for i in range(parent_count):
        total = totals[i] + gap
        j = len(best) - 1
        if total >= best[j]:
            break
        while j > 0 and best[j - 1] > total:
            best[j] = best[j - 1]
            j -= 1
        best[j] = total


@inlined
def pair_of(option: int, pair_end: int) -> int:
    """Return the pair of a row's option, -1 for unmatched."""
    return option if option < pair_end else -1


@inlined
def enter_solution(
    total: float, count: int, piece: Block, option: Ints, ranking: Ranking
) -> int:
    """Enter the present choice into the ranking and return its length.

    The choice costs ``total``. It replaces the dearest solution of a full ranking.
    """
    order = ranking.order
    cost = ranking.cost
    k = len(ranking.order)
    number = count
    if count == k:
        number = order[k - 1]
    else:
        count += 1
    cost[number] = total
    for a in range(piece.n):
        ranking.pairs[ranking.start + number * piece.n + a] = pair_of(
            option[a], piece.pair_end[a]
        )
    i = count - 1
    while i > 0 and cost[order[i - 1]] > total:
        order[i] = order[i - 1]
        i -= 1
    order[i] = number
    return count


@inlined
def is_matching(piece: Block, option: Ints, match: Ints) -> bool:
    """Compare the present choice with a matching."""
    equal = True
    for a in range(piece.n):
        equal &= match[a] == pair_of(option[a], piece.pair_end[a])
    return equal


@inlined
def offer_solution(
    total: float,
    gap: float,
    limit: float,
    count: int,
    piece: Block,
    option: Ints,
    match: Ints,
    bound: Bound,
    ranking: Ranking,
) -> int:
    """Rank the present choice if it can matter and count all.

    It costs ``total``, by ``gap`` more than the cheapest solution, which is ``match``.
    """
    if gap <= limit and (
        count < len(ranking.order) or total < ranking.cost[ranking.order[-1]]
    ):
        count = enter_solution(total, count, piece, option, ranking)
        if bound.parent_count > 0 and not is_matching(piece, option, match):
            note(bound.best, bound.totals, bound.parent_count, gap)
    return count


@part
def enumerate_solutions(
    piece: Block,
    matching: Matching,
    root_cost: float,
    bound: Bound,
    choice: Choices,
    ranking: Ranking,
    patience: int,
) -> int:
    """Rank the solutions that can matter.

    They can be among the k cheapest of all. Returns how many there are, at most k; -1,
    with ``bound.best`` spoilt, if more than ``patience`` partial choices would have to
    be looked at. ``matching``: the cheapest solution, which costs ``root_cost``, and
    its potentials; zeros if it is not known.
    """
    pair_start = piece.pair_start
    pair_end = piece.pair_end
    column = piece.pair_column
    cost = piece.pair_cost
    u = matching.u
    v = matching.v
    column_used, option, lower_bound, total_cost = choice
    n = piece.n
    count = 0
    x = 0
    lower_bound[0] = 0.0
    total_cost[0] = 0.0
    option[0] = pair_start[0] - 1
    limit = limit_of(bound)
    while x >= 0:
        # the next option of row x within the limit: its pairs, then unmatched
        e = option[x]
        end = pair_end[x]
        if pair_start[x] <= e < end:
            column_used[column[e]] = False
        e += 1
        while e < end and (
            column_used[column[e]]
            or lower_bound[x] + cost[e] - u[x] - v[column[e]] > limit
        ):
            e += 1
        option[x] = e
        if e > end or (e == end and lower_bound[x] - u[x] > limit):
            x -= 1
            continue
        if e < end:
            column_used[column[e]] = True
            lower_bound[x + 1] = lower_bound[x] + cost[e] - u[x] - v[column[e]]
            total_cost[x + 1] = total_cost[x] + cost[e]
        else:
            lower_bound[x + 1] = lower_bound[x] - u[x]
            total_cost[x + 1] = total_cost[x]
        patience -= 1
        if patience < 0:
            column_used[: piece.m] = False
            count = -1
            break
        if x + 1 < n:
            x += 1
            option[x] = pair_start[x] - 1
            continue
        total = total_cost[n]
        gap = total - root_cost
        count = offer_solution(
            total, gap, limit, count, piece, option, matching.match, bound, ranking
        )
        limit = limit_of(bound)
    return count
