"""The solutions of all pieces: roots first, then, under a bound that falls, whatever can matter."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import first_floats, flags, float_table, floats, floats_of, int_table, ints, ints_of
from .compile import kernel
from .heap import sorted_numbers
from .murty import best_solutions
from .shortest_path import cost_of, finish_root, greedy_start
from .small import choices, enumerate_all, enumerate_solutions, note, single_row_root

AT_ONCE = 40  # choices of a piece: up to here all its solutions are found, before a bound is known
SURELY = 900  # choices of a piece: up to here it is enumerated in any case
PATIENCE = 100  # partial choices to look at per solution asked for; Murty's search costs about as much


@kernel
def totals_of(piece_of: Ints, base: Floats, root_cost: Floats) -> Floats:
    """Cost of the cheapest solution of each parent, [P]."""
    total = first_floats(base, len(base))
    for p in range(piece_of.shape[0]):
        for c in range(piece_of.shape[1]):
            if piece_of[p, c] >= 0:
                total[p] += root_cost[piece_of[p, c]]
    return total


@kernel
def totals_of_pieces(piece_of: Ints, total: Floats, ranked: Ints, pieces: int) -> tuple[Floats, Ints]:
    """Totals of the parents of each piece, increasing, and where those of each begin [Q + 1].

    ``ranked``: the parents, cheapest first.
    """
    P, C = piece_of.shape
    start = ints_of(pieces + 2, 0)
    for p in range(P):
        for c in range(C):
            start[piece_of[p, c] + 2] += 1  # no piece, -1, counts at 1
    start[1] = 0
    for q in range(pieces):
        start[q + 2] += start[q + 1]
    roots = floats(start[pieces + 1])
    for p in ranked:
        for c in range(C):
            q = piece_of[p, c]
            if q >= 0:
                roots[start[q + 1]] = total[p]
                start[q + 1] += 1
    return roots, start


@kernel
def in_order(product: Floats, most_choices: int, roots: Floats, roots_start: Ints) -> tuple[Ints, int]:
    """All pieces: small ones by their size, then, from a number that is returned, large ones of the cheapest parents.

    So the bound has fallen when the costly ones come.
    """
    Q, small, key = len(product), 0, floats(len(product))
    for q in range(Q):
        small += product[q] <= most_choices
        key[q] = product[q] if product[q] <= most_choices else np.inf
    ordered = sorted_numbers(key)
    for i in range(small + 1, Q):  # few
        q, j = ordered[i], i
        while j > small and roots[roots_start[ordered[j - 1]]] > roots[roots_start[q]]:
            ordered[j] = ordered[j - 1]
            j -= 1
        ordered[j] = q
    return ordered, small


@kernel
def solve_roots(
    component: Ints, begin: Ints, places: Ints, width: Ints, pair_start: Ints, pair_local: Ints, pair_cost: Floats,
    banned: Bools, v_start: Ints, first: Ints, last: Ints, match: Ints, owner: Ints,
    u: Floats, v: Floats, row_out: Bools, column_out: Bools, dist: Floats, through: Ints, by: Ints, seen: Ints,
    hub: Ints, root: Ints, root_u: Floats, root_v: Floats, root_cost: Floats, product: Floats,
) -> None:  # fmt: skip
    """The cheapest solution of every piece with choices left, ``product`` > 0, its potentials and cost."""
    for q in range(len(component)):
        if product[q] == 0.0:
            continue
        n, m, i = begin[q + 1] - begin[q], width[component[q]], begin[q]
        if n == 1:  # only where k is 1, and without potentials
            root[i] = single_row_root(pair_start[places[i]], pair_start[places[i] + 1], pair_cost)
            root_cost[q] = pair_cost[root[i]] if root[i] >= 0 else 0.0
            continue
        for x in range(n):
            first[x], last[x] = pair_start[places[i + x]], pair_start[places[i + x] + 1]
        if greedy_start(n, m, first, last, pair_local, pair_cost, match, owner, u, v, row_out) > 0:
            finish_root(
                n, m, first, last, pair_local, pair_cost, banned, match, owner, u, v, row_out, column_out,
                dist, through, by, seen, hub,
            )  # fmt: skip
        root_cost[q] = cost_of(match, pair_cost, n)
        for x in range(n):
            root[i + x], root_u[i + x] = match[x], u[x]
        for y in range(m):
            root_v[v_start[q] + y] = v[y]


@kernel
def load_piece(
    q: int, m: int, begin: Ints, places: Ints, pair_start: Ints, v_start: Ints, root: Ints, root_u: Floats,
    root_v: Floats, first: Ints, last: Ints, match: Ints, u: Floats, v: Floats,
) -> None:  # fmt: skip
    """Where the pairs of the rows of piece ``q`` are, its cheapest solution and potentials."""
    for i in range(begin[q], begin[q + 1]):
        x = i - begin[q]
        first[x], last[x] = pair_start[places[i]], pair_start[places[i] + 1]
        match[x], u[x] = root[i], root_u[i]
    for y in range(m):
        v[y] = root_v[v_start[q] + y]


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
def patience_for(product: int, k: int) -> int:
    """How many partial choices of a piece to look at before Murty's search takes over."""
    return 4 * SURELY if product <= SURELY else 4 * SURELY + PATIENCE * k


@kernel
def record(n: int, count: int, order: Ints, cost: Floats, sols: int, used: int, gap: Floats, pair_at: Ints) -> None:
    """Enter the ``count`` solutions of a piece as number ``sols`` and after: their gaps and where their pairs begin."""
    rise = 0.0
    for r in range(count):
        rise = max(rise, cost[order[r]] - cost[order[0]])
        gap[sols + r], pair_at[sols + r] = rise, used + order[r] * n


@kernel(inline=True)
def solve_pieces(
    k: int, component: Ints, begin: Ints, places: Ints, piece_of: Ints, width: Ints, pair_start: Ints,
    pair_local: Ints, pair_cost: Floats, base: Floats, scale: float, joint: bool, most_choices: int,
) -> tuple[Ints, Ints, Floats, Floats, Ints, Ints, Floats, float]:  # fmt: skip
    """The solutions of every piece that can be among the k best of all; all k best of each if not ``joint``.

    Returns where the solutions of each piece begin, how many it has and its least cost [Q]; their gaps and where their
    pairs begin; the pairs; the cost of each parent's cheapest solution [P]; a limit that the k-th best does not exceed.
    """
    Q, most_choices = len(component), max(most_choices, 1)
    n_most, m_most, v_start = 1, 1, ints_of(Q + 1, 0)
    for q in range(Q):
        n_most, m_most = max(n_most, begin[q + 1] - begin[q]), max(m_most, width[component[q]])
        v_start[q + 1] = v_start[q] + width[component[q]]
    root, root_u, root_v = ints(len(places)), floats(len(places)), floats(v_start[Q])
    of_row, sum_of_row = int_table(4, n_most), float_table(3, n_most + 1)  # few arrays: many arguments are slow
    first, last, match, option = of_row[0], of_row[1], of_row[2], of_row[3]
    u, lower, partial = sum_of_row[0], sum_of_row[1], sum_of_row[2]
    of_column, v, dist = int_table(4, m_most), floats(m_most), floats_of(m_most, np.inf)
    owner, through, by, seen = of_column[0], of_column[1], of_column[2], of_column[3]
    hub, row_out, column_out = ints_of(3, 0), flags(n_most), flags(m_most)
    banned, root_cost = flags(len(pair_local)), floats(Q)
    product, at_once = floats_of(Q, 1.0), 0 if k == 1 else min(AT_ONCE, most_choices)
    sol_begin, sol_count = ints(Q), ints(Q)
    gap, pair_at, sols = floats(Q * k), ints(Q * k), 0 * Q  # no literal, see compile.py
    pairs: Ints = ints(2 * k * n_most + 2 * len(places))
    used = 0 * Q
    of_solution = float_table(3, k)
    order, cost, saved, bound = ints(k), of_solution[0], of_solution[1], of_solution[2]
    for q in range(Q if k > 1 else 0):
        n = begin[q + 1] - begin[q]
        for x in range(n):
            place = places[begin[q] + x]
            first[x], last[x] = pair_start[place], pair_start[place + 1]
        size = choices(n, first, last, most_choices)
        product[q] = size
        if size <= at_once or n == 1:
            product[q] = 0.0
            pairs = with_room(pairs, used, k * n)
            count = enumerate_all(
                n, k, first, last, pair_local, pair_cost, column_out, option, partial, order, cost, pairs, used
            )
            record(n, count, order, cost, sols, used, gap, pair_at)
            root_cost[q] = cost[order[0]]
            sol_begin[q], sol_count[q] = sols, count
            sols += count
            used += count * n
    solve_roots(
        component, begin, places, width, pair_start, pair_local, pair_cost, banned, v_start,
        first, last, match, owner, u, v, row_out, column_out, dist, through, by, seen, hub,
        root, root_u, root_v, root_cost, product,
    )  # fmt: skip
    total, slack = totals_of(piece_of, base, root_cost), 1e-12 * scale
    for j in range(k):
        bound[j] = np.inf
    if k == 1:
        for q in range(Q):
            sol_begin[q], sol_count[q], gap[q] = q, 1, 0.0
        for cost_of_one in total:
            bound[0] = min(bound[0], cost_of_one)
        return sol_begin, sol_count, root_cost, gap, begin, root, total, bound[0] + slack
    ranked = sorted_numbers(total)
    for i in range(min(k, len(total))):
        bound[i] = total[ranked[i]]
    roots, roots_start = totals_of_pieces(piece_of, total, ranked, Q)
    ordered, small = in_order(product, most_choices, roots, roots_start)
    for i in range(Q):
        q = ordered[i]
        n, m, low, high = begin[q + 1] - begin[q], width[component[q]], roots_start[q], roots_start[q + 1]
        if product[q] == 0.0:
            for r in range(1, sol_count[q] if joint else 1):
                rise = gap[sol_begin[q] + r]
                if roots[low] + rise > bound[k - 1] + slack:
                    sol_count[q] = r
                    break
                note(bound, roots, low, high, rise)
            continue
        pairs = with_room(pairs, used, k * n)
        if not joint:  # each piece for itself: its root is known, and nothing else
            for j in range(k):
                bound[j] = np.inf
            bound[0], roots[low], high = 0.0, 0.0, low + 1
        load_piece(q, m, begin, places, pair_start, v_start, root, root_u, root_v, first, last, match, u, v)
        count = -1 + 0 * k
        if i < small:
            for j in range(k):
                saved[j] = bound[j]
            count = enumerate_solutions(
                n, k, first, last, pair_local, pair_cost, match, root_cost[q], u, v, bound, roots, low, high, slack,
                column_out, option, lower, partial, order, cost, pairs, used, patience_for(product[q], k),
            )  # fmt: skip
            for j in range(k if count < 0 else 0):
                bound[j] = saved[j]
        if count < 0:
            count = best_solutions(
                n, m, k, first, last, pair_local, pair_cost, banned, root_cost[q], bound, roots, low, high, slack,
                match, owner, u, v, row_out, column_out, dist, through, by, seen, hub, order, cost, pairs, used,
            )  # fmt: skip
        record(n, count, order, cost, sols, used, gap, pair_at)
        sol_begin[q], sol_count[q] = sols, count
        sols += count
        used += count * n
    return sol_begin, sol_count, root_cost, gap, pair_at, pairs, total, bound[k - 1] + slack
