"""All solutions of a small piece that can matter, by depth-first enumeration with reduced costs as lower bounds."""

from __future__ import annotations

from ...types import Bools, Floats, Ints
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
def choices(n: int, first: Ints, last: Ints, most: int) -> int:
    """Product of the choices of the rows of a piece, at most ``most`` + 1."""
    product = 1
    for x in range(n):
        product *= last[x] - first[x] + 1
        if product > most:
            return most + 1
    return product


@kernel
def enumerate_solutions(
    n: int,
    k: int,
    first: Ints,
    last: Ints,
    pair_local: Ints,
    pair_cost: Floats,
    root: Ints,
    root_cost: float,
    u: Floats,
    v: Floats,
    bound: Floats,
    roots: Floats,
    low: int,
    high: int,
    slack: float,
    taken: Bools,
    option: Ints,
    lower: Floats,
    total: Floats,
    order: Ints,
    sol_cost: Floats,
    sol_pair: Ints,
    at: int,
    patience: int,
) -> int:
    """How many solutions of a piece were found, at most k: all that can be among the k cheapest of the whole problem.

    -1, with ``bound`` spoilt, if more than ``patience`` partial choices would have to be looked at.

    ``root``: the cheapest solution, with its potentials ``u`` and ``v``. ``bound``, ``roots``: see `note`; a solution
    dearer than ``bound`` by more than ``slack`` cannot matter. Fills ``order`` [k] (numbers of the solutions, cheapest
    first), their costs and, from number ``at`` on, their pairs ``sol_pair`` [k * n] (-1: unmatched).
    """
    count, x = 0, 0
    lower[0], total[0] = 0.0, 0.0
    option[0] = first[0] - 1
    limit = bound[k - 1] - roots[low] + slack
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
        if gap > limit or (count == k and total[n] >= sol_cost[order[k - 1]]):
            continue
        place = count
        if count == k:
            place = order[k - 1]
        else:
            count += 1
        sol_cost[place] = total[n]
        is_root = True
        for a in range(n):
            pair = option[a] if option[a] < last[a] else -1
            sol_pair[at + place * n + a] = pair
            is_root = is_root and pair == root[a]
        i = count - 1
        while i > 0 and sol_cost[order[i - 1]] > total[n]:
            order[i] = order[i - 1]
            i -= 1
        order[i] = place
        if not is_root:
            note(bound, roots, low, high, gap)
            limit = bound[k - 1] - roots[low] + slack
    return count


@kernel
def enumerate_all(
    n: int, k: int, first: Ints, last: Ints, pair_local: Ints, pair_cost: Floats, taken: Bools, option: Ints,
    total: Floats, order: Ints, sol_cost: Floats, sol_pair: Ints, at: int,
) -> int:  # fmt: skip
    """As `enumerate_solutions`, for a piece so small that a bound does not pay: all solutions, at most the k best."""
    count, x = 0, 0
    total[0] = 0.0
    option[0] = first[0] - 1
    while x >= 0:
        e = option[x]
        if first[x] <= e < last[x]:
            taken[pair_local[e]] = False
        e += 1
        while e < last[x] and taken[pair_local[e]]:
            e += 1
        option[x] = e
        if e > last[x]:
            x -= 1
            continue
        cost = total[x]
        if e < last[x]:
            cost += pair_cost[e]
        if x < n - 1:
            if e < last[x]:
                taken[pair_local[e]] = True
            x += 1
            total[x], option[x] = cost, first[x] - 1
            continue
        place = count
        if count < k:
            count += 1
        elif cost < sol_cost[order[k - 1]]:
            place = order[k - 1]
        else:
            continue
        sol_cost[place] = cost
        for a in range(n):
            sol_pair[at + place * n + a] = option[a] if option[a] < last[a] else -1
        i = count - 1
        while i > 0 and sol_cost[order[i - 1]] > cost:
            order[i] = order[i - 1]
            i -= 1
        order[i] = place
    return count


@kernel
def single_row_root(first: int, last: int, pair_cost: Floats) -> int:
    """Cheapest choice of one row; -1 for none."""
    least, chosen = 0.0, -1
    for e in range(first, last):
        if pair_cost[e] < least:
            least, chosen = pair_cost[e], e
    return chosen
