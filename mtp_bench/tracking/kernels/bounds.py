"""What the solutions found so far say of the k cheapest of the whole problem: dearer ones need not be looked for."""

from __future__ import annotations

import numpy as np

from ...types import Floats, Ints
from .arrays import first_floats, floats, floats_of, ints_of
from .compile import kernel


@kernel
def note(bound: Floats, roots: Floats, low: int, high: int, gap: float) -> None:
    """Enter solutions of the whole problem, one per parent of a piece, among the cheapest known, ``bound`` [k].

    The parents' cheapest solutions cost ``roots[low:high]``, the new ones ``gap`` more.
    """
    a, b = len(bound), low
    while a > 0 and b < high and roots[b] + gap < bound[a - 1]:  # a new one for the dearest
        a -= 1
        b += 1
    i = len(bound) - 1
    while b > low:
        total = roots[b - 1] + gap
        if a > 0 and bound[a - 1] > total:
            a -= 1
            bound[i] = bound[a]
        else:
            b -= 1
            bound[i] = total
        i -= 1


@kernel
def cheapest(total: Floats) -> int:
    """The parent with the cheapest solution, of equal ones the first."""
    best = 0
    for p in range(len(total)):
        if total[p] < total[best]:
            best = p
    return best


@kernel
def totals_of(of_parent: Ints, base: Floats, root_cost: Floats) -> Floats:
    """Cost of the cheapest solution of each parent, [P]."""
    total = first_floats(base, len(base))
    for p in range(of_parent.shape[0]):
        for c in range(of_parent.shape[1]):
            if of_parent[p, c] >= 0:
                total[p] += root_cost[of_parent[p, c]]
    return total


@kernel
def totals_of_pieces(of_parent: Ints, total: Floats, ranked: Ints, pieces: int) -> tuple[Floats, Ints]:
    """Totals of the parents of each piece, increasing, and where those of each begin [Q + 1].

    ``ranked``: the parents, cheapest first.
    """
    P, C = of_parent.shape
    start = ints_of(pieces + 2, 0)
    for p in range(P):
        for c in range(C):
            start[of_parent[p, c] + 2] += 1  # no piece, -1, counts at 1
    start[1] = 0
    for q in range(pieces):
        start[q + 2] += start[q + 1]
    roots = floats(start[pieces + 1])
    for p in ranked:
        for c in range(C):
            q = of_parent[p, c]
            if q >= 0:
                roots[start[q + 1]] = total[p]
                start[q + 1] += 1
    return roots, start


@kernel
def least_of(total: Floats, ranked: Ints, k: int) -> Floats:
    """The k least totals of the parents, infinite where there are fewer parents."""
    best = floats_of(k, np.inf)
    for i in range(min(k, len(total))):
        best[i] = total[ranked[i]]
    return best
