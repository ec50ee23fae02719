"""The solutions of all pieces: roots first, then, under a bound that falls, whatever can matter."""

from __future__ import annotations

import numpy as np

from ...types import Floats, Ints
from .arrays import floats, floats_of, ints, ints_of, up_to
from .bounds import cheapest, least_of, note, totals_of, totals_of_pieces
from .compile import kernel
from .heap import sorted_numbers
from .murty import best_solutions
from .shortest_path import cost_of, finish_root, greedy_start
from .small import choices, enumerate_all, enumerate_solutions, single_row_root
from .space import (
    Roots,
    Space,
    choices_in,
    largest,
    load_root,
    matching_in,
    new_roots,
    new_space,
    path_in,
    piece_in,
)
from .tables import Bound, Kept, Pieces, Problem, Solutions

AT_ONCE = 40  # choices of a piece: up to here all its solutions are found, before a bound is known
SURELY = 900  # choices of a piece: up to here it is enumerated in any case
PATIENCE = 100  # partial choices to look at per solution asked for; Murty's search costs about as much


@kernel
def record(n: int, count: int, order: Ints, cost: Floats, sols: int, used: int, gap: Floats, pair_at: Ints) -> None:
    """Enter the ``count`` solutions of a piece as number ``sols`` and after: their gaps and where their pairs begin."""
    rise = 0.0
    for r in range(count):
        rise = max(rise, cost[order[r]] - cost[order[0]])
        gap[sols + r], pair_at[sols + r] = rise, used + order[r] * n


@kernel
def products_of(problem: Problem, pieces: Pieces, k: int, most_choices: int, product: Floats) -> int:
    """Choices of every piece; 0 for those small enough to find all solutions at once, and room for these."""
    room, at_once = 0, min(AT_ONCE, most_choices)
    for q in range(len(product)):
        n = pieces.begin[q + 1] - pieces.begin[q]
        size = choices(q, pieces.begin, pieces.places, problem.pair_start, most_choices)
        product[q] = size
        if size <= at_once or n == 1:
            product[q] = 0.0
            room += (k if n == 1 else min(size, k)) * n
    return room


@kernel
def solve_small(
    k: int, problem: Problem, pieces: Pieces, space: Space, product: Floats, solutions: Solutions
) -> tuple[int, int]:
    """All solutions, at most the k best, of the pieces without a product; how many, and how many pairs they have."""
    choice, order, cost = choices_in(space), space.order, space.cost
    sols, used = 0, 0
    for q in range(len(product)):
        if product[q] > 0.0:
            continue
        piece, kept = piece_in(space, q, problem, pieces), Kept(k, order, cost, solutions.pairs, used)
        count = enumerate_all(piece, choice, kept)
        record(piece.n, count, order, cost, sols, used, solutions.gap, solutions.pair_at)
        solutions.least[q] = cost[order[0]]
        solutions.begin[q], solutions.size[q] = sols, count
        sols += count
        used += count * piece.n
    return sols, used


@kernel
def solve_roots(problem: Problem, pieces: Pieces, space: Space, product: Floats, roots: Roots) -> None:
    """The cheapest solution of every piece with a product: its pairs, its potentials and its cost."""
    matching, path = matching_in(space), path_in(space)
    for q in range(len(product)):
        if product[q] == 0.0:
            continue
        i = pieces.begin[q]
        if pieces.begin[q + 1] - i == 1:  # only where k is 1, and without potentials
            place = pieces.places[i]
            chosen = single_row_root(problem.pair_start[place], problem.pair_start[place + 1], problem.pair_cost)
            roots.pair[i], roots.cost[q] = chosen, problem.pair_cost[chosen] if chosen >= 0 else 0.0
            continue
        piece = piece_in(space, q, problem, pieces)
        if greedy_start(piece, matching) > 0:
            finish_root(piece, matching, path)
        roots.cost[q] = cost_of(matching.match, piece.cost, piece.n)
        for x in range(piece.n):
            roots.pair[i + x], roots.u[i + x] = matching.match[x], matching.u[x]
        for y in range(piece.m):
            roots.v[roots.v_start[q] + y] = matching.v[y]


@kernel
def in_order(product: Floats, most_choices: int, roots: Floats, roots_start: Ints) -> tuple[Ints, int, int]:
    """All pieces: solved ones, small ones by their size, large ones of the cheapest parents.

    So the bound has fallen when the costly ones come. Also how many of the first kind there are, and of the first two.
    """
    Q, solved, small, key = len(product), 0, 0, floats(len(product))
    for q in range(Q):
        solved += product[q] == 0.0
        small += product[q] <= most_choices
        key[q] = product[q] if product[q] <= most_choices else np.inf
    ordered = sorted_numbers(key)
    for i in range(small + 1, Q):  # few
        q, j = ordered[i], i
        while j > small and roots[roots_start[ordered[j - 1]]] > roots[roots_start[q]]:
            ordered[j] = ordered[j - 1]
            j -= 1
        ordered[j] = q
    return ordered, solved, small


@kernel
def note_solved(
    ordered: Ints, solved: int, roots: Floats, roots_start: Ints, solutions: Solutions, slack: float, bound: Floats
) -> None:
    """Lower the bound by the solutions of the pieces solved at once, and forget those that cannot matter."""
    last = len(bound) - 1
    for i in range(solved):
        q = ordered[i]
        low, high = roots_start[q], roots_start[q + 1]
        for r in range(1, solutions.size[q]):
            rise = solutions.gap[solutions.begin[q] + r]
            if roots[low] + rise > bound[last] + slack:
                solutions.size[q] = r
                break
            note(bound, roots, low, high, rise)


@kernel
def with_room(pairs: Ints, used: int, more: int) -> Ints:
    """The array, or a longer copy if there is no room for ``more`` after the first ``used``."""
    if used + more <= len(pairs):
        return pairs
    longer = ints(2 * (used + more))
    for i in range(used):
        longer[i] = pairs[i]
    return longer


@kernel
def patience_for(product: float, k: int) -> int:
    """How many partial choices of a piece to look at before Murty's search takes over."""
    return 4 * SURELY if product <= SURELY else 4 * SURELY + PATIENCE * k


@kernel
def forget_others(totals: Floats, low: int, best: Floats) -> None:
    """Let the root of a piece be all that is known, at cost 0: each piece is solved for itself."""
    for j in range(len(best)):
        best[j] = np.inf
    best[0], totals[low] = 0.0, 0.0


@kernel
def try_enumeration(
    q: int, product: float, problem: Problem, pieces: Pieces, space: Space, roots: Roots, bound: Bound, saved: Floats,
    pairs: Ints, used: int,
) -> int:  # fmt: skip
    """Solutions of piece ``q`` by enumeration; -1, and the bound is left as it was, if patience ends."""
    k = len(saved)
    for j in range(k):
        saved[j] = bound.best[j]
    piece, matching, choice = piece_in(space, q, problem, pieces), matching_in(space), choices_in(space)
    load_root(q, piece, pieces.begin[q], roots, matching)
    kept = Kept(k, space.order, space.cost, pairs, used)
    count = enumerate_solutions(piece, matching, roots.cost[q], bound, choice, kept, patience_for(product, k))
    for j in range(k if count < 0 else 0):
        bound.best[j] = saved[j]
    return count


@kernel
def search_piece(
    q: int, problem: Problem, pieces: Pieces, space: Space, roots: Roots, bound: Bound, pairs: Ints, used: int
) -> int:
    """Solutions of piece ``q`` by Murty's search."""
    piece, matching, path = piece_in(space, q, problem, pieces), matching_in(space), path_in(space)
    load_root(q, piece, pieces.begin[q], roots, matching)
    kept = Kept(len(bound.best), space.order, space.cost, pairs, used)
    return best_solutions(piece, roots.cost[q], bound, matching, path, kept)


@kernel(inline=True)
def solve_pieces(
    k: int, problem: Problem, pieces: Pieces, base: Floats, scale: float, joint: bool, most_choices: int
) -> tuple[Solutions, Floats, float]:
    """The solutions of every piece that can be among the k best of all; all k best of each if not ``joint``.

    Returns with them the cost of each parent's cheapest solution [P], and a limit that the k-th best does not exceed.
    ``base`` [P]: cost of the parents; ``scale``: what no total exceeds; a piece of at most ``most_choices`` choices is
    enumerated.
    """
    component, begin, of_parent = pieces.component, pieces.begin, pieces.of_parent
    Q, most_choices, slack = len(component), max(most_choices, 1), 1e-12 * scale
    n, m = largest(pieces, problem.width)
    space = new_space(n, m, k, len(problem.pair_cost))
    roots = new_roots(component, len(pieces.places), problem.width)
    product = floats_of(Q, 1.0)
    if k == 1:
        solve_roots(problem, pieces, space, product, roots)
        total = totals_of(of_parent, base, roots.cost)
        limit = total[cheapest(total)] + slack
        return Solutions(up_to(Q), ints_of(Q, 1), roots.cost, floats_of(Q, 0.0), begin, roots.pair), total, limit
    room = products_of(problem, pieces, k, most_choices, product)
    sol_begin, sol_count, gap, pair_at, pairs = ints(Q), ints(Q), floats(Q * k), ints(Q * k), ints(room)
    solutions = Solutions(sol_begin, sol_count, roots.cost, gap, pair_at, pairs)
    sols, used = solve_small(k, problem, pieces, space, product, solutions)
    solve_roots(problem, pieces, space, product, roots)
    total = totals_of(of_parent, base, roots.cost)
    ranked = sorted_numbers(total)
    best, saved, order, cost = least_of(total, ranked, k), floats(k), space.order, space.cost
    totals, totals_start = totals_of_pieces(of_parent, total, ranked, Q)
    ordered, solved, small = in_order(product, most_choices, totals, totals_start)
    if joint:
        note_solved(ordered, solved, totals, totals_start, solutions, slack, best)
    for i in range(solved, Q):
        q = ordered[i]
        low, high, n = totals_start[q], totals_start[q + 1], begin[q + 1] - begin[q]
        if not joint:
            forget_others(totals, low, best)
            high = low + 1
        pairs = with_room(pairs, used, k * n)
        bound = Bound(best, totals, low, high, slack)  # pyright: ignore[reportArgumentType]
        count = -1 + 0 * k  # no literal, see compile.py
        if i < small:
            count = try_enumeration(q, product[q], problem, pieces, space, roots, bound, saved, pairs, used)
        if count < 0:
            count = search_piece(q, problem, pieces, space, roots, bound, pairs, used)
        record(n, count, order, cost, sols, used, gap, pair_at)
        sol_begin[q], sol_count[q] = sols, count
        sols += count
        used += count * n
    return Solutions(sol_begin, sol_count, roots.cost, gap, pair_at, pairs), total, best[k - 1] + slack
