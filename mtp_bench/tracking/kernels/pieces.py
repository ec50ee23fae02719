"""The solutions of all pieces, as many as can matter.

All those of small pieces come first, then those of the others below a falling bound.
"""

import numpy as np

from ...core import Floats, Ints
from .compile import inlined, part
from .enumeration import enumerate_solutions, note
from .heap import sorted_numbers
from .murty import search_solutions
from .shortest_path import cost_of, solve_root
from .tables import (
    Bound,
    Pieces,
    Problem,
    Ranking,
    Roots,
    Solutions,
    Workspace,
    load_piece,
    new_roots,
    new_workspace,
)

# choices of a piece, up to which all its solutions are found before a bound is known
MAX_CHOICES_AT_ONCE = 40
# choices of a piece, up to which it is enumerated as long as patience lasts
MAX_CHOICES = 10**7
# partial choices to look at, and more per solution asked for: Murty's search costs
# about as much
PATIENCE = 3600
PATIENCE_PER_SOLUTION = 100
# of the sum of all costs, which no total exceeds
_ROUNDING_SHARE = 1e-12


@part
def count_choices(problem: Problem, pieces: Pieces, choices: Floats, k: int) -> int:
    """Count the choices of pieces and the pairs of all solutions.

    Returns the number of pairs. The number of choices is 0 where all solutions are
    found at once.
    """
    pair_count = 0
    for q in range(len(choices)):
        start = pieces.row_start[q]
        end = pieces.row_start[q + 1]
        product = 1
        for place in pieces.places[start:end]:
            product *= problem.pair_start[place + 1] - problem.pair_start[place] + 1
            if product > MAX_CHOICES and end - start > 1:
                product = MAX_CHOICES + 1
        choices[q] = product
        solution_count = k
        if product <= MAX_CHOICES_AT_ONCE or end - start == 1:
            choices[q] = 0.0
            solution_count = product
        pair_count += solution_count * (end - start)
    return pair_count


@inlined
def record(
    q: int,
    n: int,
    count: int,
    ranking: Ranking,
    next_solution: int,
    solutions: Solutions,
) -> None:
    """Enter the ``count`` solutions ranked of piece ``q``, of ``n`` rows."""
    rise = 0.0
    cost = ranking.cost
    order = ranking.order
    solutions.first[q] = next_solution
    solutions.solution_count[q] = count
    for r in range(count):
        rise = max(rise, cost[order[r]] - cost[order[0]])
        solutions.gap[next_solution + r] = rise
        solutions.pair_start[next_solution + r] = ranking.start + order[r] * n


@inlined
def rank_row(
    start: int, end: int, pair_cost: Floats, k: int, cost: Floats, pair: Ints
) -> int:
    """Write the best choices of a single row and count them.

    There are at most k. Its pairs are those from ``start`` to ``end``. The choices come
    with their ``cost``, cheapest first.
    """
    count = 0
    for e in range(start, end + 1):
        choice_pair = -1
        choice_cost = 0.0
        if e < end:
            choice_pair = e
            choice_cost = pair_cost[e]
        i = count
        while i > 0 and cost[i - 1] > choice_cost:
            if i < k:
                cost[i] = cost[i - 1]
                pair[i] = pair[i - 1]
            i -= 1
        if i < k:
            cost[i] = choice_cost
            pair[i] = choice_pair
        count = min(count + 1, k)
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
    """Find the solutions of the pieces without choices.

    They are at most the k best. Returns how many there are, and how many pairs they
    have.
    """
    no_bound = Bound(np.full(len(space.order), np.inf), np.zeros(1), 0, 0.0)
    matching = space.matching
    choice = space.choice
    order = space.order
    pairs = solutions.pairs
    next_solution = 0
    next_pair = 0
    for q in range(len(choices)):
        if choices[q] > 0.0:
            continue
        row_start = pieces.row_start[q]
        if pieces.row_start[q + 1] - row_start == 1:  # most pieces
            place = pieces.places[row_start]
            start = problem.pair_start[place]
            end = problem.pair_start[place + 1]
            cost = solutions.gap[next_solution:]
            pair = pairs[next_pair:]
            count = rank_row(start, end, problem.pair_cost, len(order), cost, pair)
            root_cost[q] = cost[0]
            solutions.first[q] = next_solution
            solutions.solution_count[q] = count
            for r in range(count):
                solutions.gap[next_solution + r] -= root_cost[q]
                solutions.pair_start[next_solution + r] = next_pair + r
            next_solution += count
            next_pair += count
            continue
        piece = load_piece(q, problem, pieces, space)
        ranking = Ranking(order, space.cost, pairs, next_pair)
        count = enumerate_solutions(
            piece, matching, 0.0, no_bound, choice, ranking, PATIENCE
        )
        record(q, piece.n, count, ranking, next_solution, solutions)
        root_cost[q] = ranking.cost[order[0]]
        next_solution += count
        next_pair += count * piece.n
    return next_solution, next_pair


@part
def solve_row_root(q: int, problem: Problem, pieces: Pieces, roots: Roots) -> None:
    """Find the cheapest choice of the single row of piece ``q``.

    It is needed where k is 1, and without potentials.
    """
    x = pieces.row_start[q]
    place = pieces.places[x]
    roots.cost[q] = 0.0
    roots.pair[x] = -1
    for e in range(problem.pair_start[place], problem.pair_start[place + 1]):
        if problem.pair_cost[e] < roots.cost[q]:
            roots.cost[q] = problem.pair_cost[e]
            roots.pair[x] = e


@part
def solve_roots(
    problem: Problem, pieces: Pieces, choices: Floats, space: Workspace, roots: Roots
) -> None:
    """Find the cheapest solution of every piece with choices."""
    matching = space.matching
    path = space.path
    for q in range(len(choices)):
        if choices[q] == 0.0:
            continue
        row_start = pieces.row_start[q]
        if pieces.row_start[q + 1] - row_start == 1:
            solve_row_root(q, problem, pieces, roots)
            continue
        piece = load_piece(q, problem, pieces, space)
        solve_root(piece, matching, path)
        roots.cost[q] = cost_of(matching.match, piece.pair_cost, piece.n)
        for x in range(piece.n):
            roots.pair[row_start + x] = matching.match[x]
            roots.u[row_start + x] = matching.u[x]
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
    ranking: Ranking,
) -> int:
    """Rank a piece's solutions that can matter and count them.

    They are enumerated or, if that takes too long, found by Murty's search.
    """
    matching = space.matching
    row_start = pieces.row_start[q]
    k = len(ranking.order)
    piece = load_piece(q, problem, pieces, space)
    for x in range(piece.n):
        matching.match[x] = roots.pair[row_start + x]
        matching.u[x] = roots.u[row_start + x]
    for y in range(piece.m):
        matching.v[y] = roots.v[roots.v_start[q] + y]
    if choices <= MAX_CHOICES:
        saved_best = bound.best.copy()
        patience = PATIENCE + PATIENCE_PER_SOLUTION * k
        count = enumerate_solutions(
            piece, matching, roots.cost[q], bound, space.choice, ranking, patience
        )
        if count >= 0:
            return count
        bound.best[:] = saved_best
    return search_solutions(piece, roots.cost[q], bound, matching, space.path, ranking)


@part
def totals_of(of_parent: Ints, base_cost: Floats, root_cost: Floats) -> Floats:
    """Sum the cost of the cheapest solution of each parent [P]."""
    totals = base_cost.copy()
    for p in range(of_parent.shape[0]):
        for c in range(of_parent.shape[1]):
            if of_parent[p, c] >= 0:
                totals[p] += root_cost[of_parent[p, c]]
    return totals


@inlined
def write_totals(
    q: int, pieces: Pieces, ranked: Ints, totals: Floats, piece_totals: Floats
) -> int:
    """Write the totals of a piece's parents and count them.

    Parents are ``ranked`` [P] by their ``totals`` [P].
    """
    component = pieces.component[q]
    size = 0
    for p in ranked:
        if pieces.of_parent[p, component] == q:
            piece_totals[size] = totals[p]
            size += 1
    return size


@inlined
def note_small(
    gap: Floats,
    first: int,
    count: int,
    best: Floats,
    totals: Floats,
    parent_count: int,
    slack: float,
) -> int:
    """Lower the bound by the solutions of a small piece.

    Returns how many of them can matter.
    """
    r = 1
    while r < count and totals[0] + gap[first + r] <= best[-1] + slack:
        note(best, totals, parent_count, gap[first + r])
        r += 1
    return r


@part
def rounding_slack(pair_cost: Floats, base_cost: Floats) -> float:
    """Bound the rounding of totals by the sum of all costs."""
    cost_sum = 0.0
    max_base_cost = 0.0
    for cost in pair_cost:
        cost_sum += abs(cost)
    for cost in base_cost:
        max_base_cost = max(max_base_cost, abs(cost))
    return _ROUNDING_SHARE * (cost_sum + max_base_cost)


@inlined
def solve_pieces(
    problem: Problem, pieces: Pieces, base_cost: Floats, k: int
) -> tuple[Solutions, Floats, float]:
    """Find the solutions of every piece that can matter.

    They can be among the k best of all. Returns with them the cost of each parent's
    cheapest solution [P], and a limit that the k-th best does not exceed. ``base_cost``
    [P]: of the parents.
    """
    of_parent = pieces.of_parent
    Q = len(pieces.component)
    slack = rounding_slack(problem.pair_cost, base_cost)
    space = new_workspace(problem, pieces, k)
    roots = new_roots(problem, pieces)
    choices = np.ones(Q)
    if k == 1:
        solve_roots(problem, pieces, choices, space, roots)
        totals = totals_of(of_parent, base_cost, roots.cost)
        cheapest = Solutions(
            np.arange(Q),
            np.ones(Q, np.int64),
            np.zeros(Q),
            pieces.row_start,
            roots.pair,
        )
        return cheapest, totals, totals[sorted_numbers(totals, len(totals))[0]] + slack
    pairs: Ints = np.empty(count_choices(problem, pieces, choices, k), np.int64)
    numbers = np.empty((2, Q), np.int64)
    pair_start = np.empty(Q * k, np.int64)
    solutions = Solutions(numbers[0], numbers[1], np.empty(Q * k), pair_start, pairs)
    next_solution, next_pair = solve_small(
        problem, pieces, choices, space, roots.cost, solutions
    )
    solve_roots(problem, pieces, choices, space, roots)
    totals = totals_of(of_parent, base_cost, roots.cost)
    ranked = sorted_numbers(totals, len(totals))
    best = np.full(k, np.inf)
    for i in range(min(k, len(totals))):
        best[i] = totals[ranked[i]]
    piece_totals = np.empty(len(base_cost))
    for q in range(Q):
        if choices[q] == 0.0:
            parent_count = write_totals(q, pieces, ranked, totals, piece_totals)
            first = solutions.first[q]
            count = solutions.solution_count[q]
            solutions.solution_count[q] = note_small(
                solutions.gap, first, count, best, piece_totals, parent_count, slack
            )
    # the bound has fallen when the costly pieces come
    for q in sorted_numbers(choices, Q):
        if choices[q] == 0.0:
            continue
        parent_count = write_totals(q, pieces, ranked, totals, piece_totals)
        n = pieces.row_start[q + 1] - pieces.row_start[q]
        ranking = Ranking(space.order, space.cost, pairs, next_pair)
        bound = Bound(best, piece_totals, parent_count, slack)
        count = solve_large(
            q, choices[q], problem, pieces, space, roots, bound, ranking
        )
        record(q, n, count, ranking, next_solution, solutions)
        next_solution += count
        next_pair += count * n
    return solutions, totals, best[k - 1] + slack
