"""The solutions of all pieces: all those of small pieces first, then those of the others below a falling bound."""

from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, part
from .enumeration import enumerate_solutions, note
from .heap import sorted_numbers
from .murty import search_solutions
from .shortest_path import cost_of, solve_root
from .tables import (
    Block,
    Bound,
    Choices,
    Kept,
    Matching,
    Path,
    Pieces,
    Problem,
    Solutions,
)

AT_ONCE = 40  # choices of a piece: up to here all its solutions are found, before a bound is known
MOST_CHOICES = 10**7  # of a piece that is enumerated as long as patience lasts
PATIENCE = 3600  # partial choices to look at, and
PATIENCE_PER_SOLUTION = (
    100  # more per solution asked for; Murty's search costs about as much
)


class Workspace(NamedTuple):
    """Arrays for one piece at a time."""

    first: Ints
    last: Ints
    banned: Bools
    matching: Matching
    path: Path
    choice: Choices
    order: Ints  # [k]
    cost: Floats  # [k]


class Roots(NamedTuple):
    """The cheapest solution of every piece."""

    pair: Ints  # of each row, in the order of `Pieces.places`
    u: Floats  # potential of each row, in that order
    v: Floats  # potentials of the columns of each piece
    v_start: Ints  # [Q + 1] where those begin
    cost: Floats  # [Q]


@part
def new_workspace(problem: Problem, pieces: Pieces, k: int) -> Workspace:
    """Workspace for the largest piece; few arrays, since each takes time to make."""
    n = 1
    m = 1
    for q in range(len(pieces.component)):
        n = max(n, pieces.begin[q + 1] - pieces.begin[q])
        m = max(m, problem.width[pieces.component[q]])
    rows = np.empty((4, n), np.int64)
    columns = np.empty((4, m), np.int64)
    row_sums = np.zeros((3, n + 1))
    column_sums = np.zeros((2, m))
    for y in range(m):
        column_sums[1, y] = np.inf
    row_out = np.zeros(n, np.bool_)
    column_out = np.zeros(m, np.bool_)
    return Workspace(
        rows[0],
        rows[1],
        np.zeros(len(problem.cost), np.bool_),
        Matching(rows[2], columns[0], row_sums[0], column_sums[0], row_out, column_out),
        Path(column_sums[1], columns[1], columns[2], columns[3], np.zeros(3, np.int64)),
        Choices(column_out, rows[3], row_sums[1], row_sums[2]),
        np.empty(k, np.int64),
        np.empty(k),
    )


@part
def new_roots(problem: Problem, pieces: Pieces) -> Roots:
    """Arrays for the cheapest solution of every piece, to be filled in."""
    Q = len(pieces.component)
    rows = len(pieces.places)
    v_start = np.zeros(Q + 1, np.int64)
    for q in range(Q):
        v_start[q + 1] = v_start[q] + problem.width[pieces.component[q]]
    return Roots(
        np.empty(rows, np.int64),
        np.empty(rows),
        np.empty(v_start[Q]),
        v_start,
        np.empty(Q),
    )


@inlined
def load_piece(
    q: int, problem: Problem, pieces: Pieces, first: Ints, last: Ints, banned: Bools
) -> Block:
    """Piece ``q``, with its rows and columns numbered from 0."""
    low = pieces.begin[q]
    high = pieces.begin[q + 1]
    for i in range(low, high):
        place = pieces.places[i]
        first[i - low] = problem.first[place]
        last[i - low] = problem.first[place + 1]
    return Block(
        high - low,
        problem.width[pieces.component[q]],
        first,
        last,
        problem.column,
        problem.cost,
        banned,
    )


@part
def count_choices(problem: Problem, pieces: Pieces, choices: Floats, k: int) -> int:
    """Write the number of choices of every piece, 0 where all solutions are found at once; pairs of all solutions."""
    pairs = 0
    for q in range(len(choices)):
        low = pieces.begin[q]
        high = pieces.begin[q + 1]
        product = 1
        for place in pieces.places[low:high]:
            product *= problem.first[place + 1] - problem.first[place] + 1
            if product > MOST_CHOICES and high - low > 1:
                product = MOST_CHOICES + 1
        choices[q] = product
        if product <= AT_ONCE or high - low == 1:
            choices[q] = 0.0
        pairs += (k if choices[q] > 0.0 else product) * (high - low)
    return pairs


@inlined
def record(
    q: int, n: int, count: int, kept: Kept, next_solution: int, solutions: Solutions
) -> None:
    """Enter the ``count`` solutions kept of piece ``q``, of ``n`` rows."""
    rise = 0.0
    cost = kept.cost
    order = kept.order
    solutions.begin[q], solutions.size[q] = next_solution, count
    for r in range(count):
        rise = max(rise, cost[order[r]] - cost[order[0]])
        solutions.gap[next_solution + r] = rise
        solutions.pair_at[next_solution + r] = kept.at + order[r] * n


@inlined
def rank_row(
    first: int, last: int, pair_cost: Floats, k: int, cost: Floats, pair: Ints
) -> int:
    """Write the at most k best choices of a single row, cheapest first, with their costs; how many."""
    count = 0
    for e in range(first, last + 1):
        price = pair_cost[e] if e < last else 0.0
        i = count
        while i > 0 and cost[i - 1] > price:
            if i < k:
                cost[i] = cost[i - 1]
                pair[i] = pair[i - 1]
            i -= 1
        if i < k:
            cost[i] = price
            pair[i] = e if e < last else -1
            count += 1 if count < k else 0
    return count


@inlined
def solve_small(
    problem: Problem,
    pieces: Pieces,
    choices: Floats,
    space: Workspace,
    root_cost: Floats,
    solutions: Solutions,
) -> tuple[int, int]:
    """Solutions, at most the k best, of the pieces without choices; how many, and how many pairs they have."""
    no_bound = Bound(np.full(len(space.order), np.inf), np.zeros(1), 0, 0.0)
    first = space.first
    last = space.last
    banned = space.banned
    matching = space.matching
    choice = space.choice
    order = space.order
    kept_cost = space.cost
    pairs = solutions.pairs
    next_solution = 0
    used = 0
    for q in range(len(choices)):
        if choices[q] > 0.0:
            continue
        begin = pieces.begin[q]
        if pieces.begin[q + 1] - begin == 1:  # most pieces
            low = problem.first[pieces.places[begin]]
            high = problem.first[pieces.places[begin] + 1]
            cost = solutions.gap[next_solution:]
            pair = pairs[used:]
            count = rank_row(low, high, problem.cost, len(order), cost, pair)
            root_cost[q], solutions.begin[q], solutions.size[q] = (
                cost[0],
                next_solution,
                count,
            )
            for r in range(count):
                solutions.gap[next_solution + r] -= root_cost[q]
                solutions.pair_at[next_solution + r] = used + r
            next_solution += count
            used += count
            continue
        piece = load_piece(q, problem, pieces, first, last, banned)
        kept = Kept(order, kept_cost, pairs, used)
        count = enumerate_solutions(
            piece, matching, 0.0, no_bound, choice, kept, PATIENCE
        )
        record(q, piece.n, count, kept, next_solution, solutions)
        root_cost[q] = kept_cost[order[0]]
        next_solution += count
        used += count * piece.n
    return next_solution, used


@part
def solve_roots(
    problem: Problem, pieces: Pieces, choices: Floats, space: Workspace, roots: Roots
) -> None:
    """The cheapest solution of every piece with choices: its pairs, its potentials and its cost."""
    first = space.first
    last = space.last
    banned = space.banned
    matching = space.matching
    path = space.path
    for q in range(len(choices)):
        if choices[q] == 0.0:
            continue
        begin = pieces.begin[q]
        if (
            pieces.begin[q + 1] - begin == 1
        ):  # only where k is 1, and without potentials
            place = pieces.places[begin]
            roots.cost[q], roots.pair[begin] = 0.0, -1
            for e in range(problem.first[place], problem.first[place + 1]):
                if problem.cost[e] < roots.cost[q]:
                    roots.cost[q], roots.pair[begin] = problem.cost[e], e
            continue
        piece = load_piece(q, problem, pieces, first, last, banned)
        solve_root(piece, matching, path)
        roots.cost[q] = cost_of(matching.match, piece.cost, piece.n)
        for x in range(piece.n):
            roots.pair[begin + x], roots.u[begin + x] = matching.match[x], matching.u[x]
        for y in range(piece.m):
            roots.v[roots.v_start[q] + y] = matching.v[y]


@inlined
def solve_large(
    q: int,
    choices: float,
    problem: Problem,
    pieces: Pieces,
    space: Workspace,
    roots: Roots,
    bound: Bound,
    kept: Kept,
) -> int:
    """Number of solutions kept of piece ``q``: by enumeration or, if that takes too long, by Murty's search."""
    matching = space.matching
    begin = pieces.begin[q]
    k = len(kept.order)
    piece = load_piece(q, problem, pieces, space.first, space.last, space.banned)
    for x in range(piece.n):
        matching.match[x], matching.u[x] = roots.pair[begin + x], roots.u[begin + x]
    for y in range(piece.m):
        matching.v[y] = roots.v[roots.v_start[q] + y]
    if choices <= MOST_CHOICES:
        saved = bound.best.copy()
        patience = PATIENCE + PATIENCE_PER_SOLUTION * k
        count = enumerate_solutions(
            piece, matching, roots.cost[q], bound, space.choice, kept, patience
        )
        if count >= 0:
            return count
        for j in range(k):
            bound.best[j] = saved[j]
    return search_solutions(piece, roots.cost[q], bound, matching, space.path, kept)


@part
def totals_of(of_parent: Ints, base: Floats, root_cost: Floats) -> Floats:
    """Cost of the cheapest solution of each parent, [P]."""
    total = base.copy()
    for p in range(of_parent.shape[0]):
        for c in range(of_parent.shape[1]):
            if of_parent[p, c] >= 0:
                total[p] += root_cost[of_parent[p, c]]
    return total


@inlined
def write_totals(
    q: int, component: int, of_parent: Ints, ranked: Ints, total: Floats, totals: Floats
) -> int:
    """Write the totals of the parents of piece ``q``, increasing, into ``totals``; how many there are."""
    size = 0
    for p in ranked:
        if of_parent[p, component] == q:
            totals[size] = total[p]
            size += 1
    return size


@inlined
def note_small(
    gap: Floats,
    begin: int,
    size: int,
    best: Floats,
    totals: Floats,
    parents: int,
    slack: float,
) -> int:
    """Lower the bound by the solutions of a piece solved at once; how many of them can matter."""
    mattering = 1
    while mattering < size and totals[0] + gap[begin + mattering] <= best[-1] + slack:
        note(best, totals, parents, gap[begin + mattering])
        mattering += 1
    return mattering


@inlined
def solve_pieces(
    problem: Problem, pieces: Pieces, base: Floats, k: int
) -> tuple[Solutions, Floats, float]:
    """The solutions of every piece that can be among the k best of all.

    Returns with them the cost of each parent's cheapest solution [P], and a limit that the k-th best does not exceed.
    ``base`` [P]: cost of the parents.
    """
    component = pieces.component
    begin = pieces.begin
    of_parent = pieces.of_parent
    Q = len(pieces.component)
    paired = 0.0
    most = 0.0
    for price in problem.cost:
        paired += abs(price)
    for price in base:
        most = max(most, abs(price))
    slack = 1e-12 * (paired + most)  # of what no total exceeds
    space = new_workspace(problem, pieces, k)
    roots = new_roots(problem, pieces)
    choices = np.ones(Q)
    if k == 1:
        solve_roots(problem, pieces, choices, space, roots)
        total = totals_of(of_parent, base, roots.cost)
        cheapest = Solutions(
            np.arange(Q), np.ones(Q, np.int64), np.zeros(Q), begin, roots.pair
        )
        return cheapest, total, total[sorted_numbers(total, len(total))[0]] + slack
    pairs: Ints = np.empty(count_choices(problem, pieces, choices, k), np.int64)
    numbers = np.empty((2, Q), np.int64)
    gap = np.empty(Q * k)
    pair_at = np.empty(Q * k, np.int64)
    solutions = Solutions(numbers[0], numbers[1], gap, pair_at, pairs)
    next_solution, used = solve_small(
        problem, pieces, choices, space, roots.cost, solutions
    )
    solve_roots(problem, pieces, choices, space, roots)
    total = totals_of(of_parent, base, roots.cost)
    ranked = sorted_numbers(total, len(total))
    best = np.full(k, np.inf)
    totals = np.empty(len(base))
    for i in range(min(k, len(total))):
        best[i] = total[ranked[i]]
    for q in range(Q):
        if choices[q] == 0.0:
            parents = write_totals(q, component[q], of_parent, ranked, total, totals)
            numbers[1, q] = note_small(
                gap, numbers[0, q], numbers[1, q], best, totals, parents, slack
            )
    for q in sorted_numbers(
        choices, Q
    ):  # the bound has fallen when the costly ones come
        if choices[q] == 0.0:
            continue
        parents = write_totals(q, component[q], of_parent, ranked, total, totals)
        n = begin[q + 1] - begin[q]
        kept = Kept(space.order, space.cost, pairs, used)
        bound = Bound(best, totals, parents, slack)
        count = solve_large(q, choices[q], problem, pieces, space, roots, bound, kept)
        record(q, n, count, kept, next_solution, solutions)
        next_solution += count
        used += count * n
    return (
        Solutions(numbers[0], numbers[1], gap, pair_at, pairs),
        total,
        best[k - 1] + slack,
    )
