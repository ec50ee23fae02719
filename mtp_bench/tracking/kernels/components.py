"""What has to be solved: the gating components, and the distinct row subsets that parents have of each.

Rows of two components share no column, so that each component is a problem of its own (union-find over the rows of all
parents). Two parents with the same rows of a component share its solutions: such a pair is a **piece**.
"""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import first_ints, flags, floats, int_table, ints, ints_of, up_to
from .compile import kernel
from .tables import Pieces, Problem

BITS = 30  # of a word, so that nothing overflows when words are hashed


@kernel
def rows_held(member: Bools) -> Ints:
    """How many parents hold each row, [N]."""
    held = ints_of(member.shape[1], 0)
    for p in range(member.shape[0]):
        for row in range(member.shape[1]):
            held[row] += member[p, row]
    return held


@kernel
def packed_rows(member: Bools, held: Ints, rows: Ints, start: Ints, lowest: Ints) -> tuple[Ints, Ints]:
    """The rows of each parent as bits, `BITS` to a word [H, W], of rows that some parents hold and some do not.

    Also where the words of each component begin [C + 1]; after the last come those of rows without a component.
    """
    H, C, N = member.shape[0], len(start) - 1, len(held)
    row_at, word_at, word_start = ints(N), ints(N + 1), ints(C + 1)
    used, words = 0, 0
    for c in range(C + 1):
        word_start[c] = words
        room = 0
        for i in range(start[c] if c < C else 0, start[c + 1] if c < C else N):
            row = rows[i] if c < C else i
            if held[row] == 0 or held[row] == H or (c == C and lowest[row] >= 0):
                continue
            if room == 0:
                word_at[words] = used
                words += 1
                room = BITS
            row_at[used] = row
            used += 1
            room -= 1
    word_at[words] = used
    bits = int_table(H, words)
    for p in range(H):
        for w in range(words):
            word = 0
            for i in range(word_at[w], word_at[w + 1]):
                word = 2 * word + member[p, row_at[i]]
            bits[p, w] = word
    return bits, word_start


@kernel
def new_table(parents: int) -> Ints:
    """An empty table for `place_in`, of a power of two."""
    size = 4
    while size < 2 * parents:
        size *= 2
    return ints_of(size, -1)


@kernel
def place_in(table: Ints, bits: Ints, p: int, low: int, high: int) -> int:
    """Where the hash table has a parent with the words ``low`` to ``high`` of parent ``p``, or has room for it."""
    key = 0
    for w in range(low, high):
        key = (key * 1103515245 + bits[p, w] * 7919) & 0xFFFFFFF
        key ^= key >> 11
    at = key & (len(table) - 1)
    while table[at] >= 0:
        w = low
        while w < high and bits[table[at], w] == bits[p, w]:
            w += 1
        if w == high:
            break
        at = (at + 1) & (len(table) - 1)
    return int(at)


@kernel
def distinct_parents(bits: Ints, base: Floats) -> Ints:
    """Numbers of the parents to search, increasing: of those with equal rows the cheapest, of equal ones the first."""
    total = len(base)
    kept, used = up_to(total), 0
    if total == 1:
        return kept
    table, dropped = new_table(total), flags(total)
    for p in range(total):
        at = place_in(table, bits, p, 0 * p, bits.shape[1])
        best = table[at]
        if best >= 0 and base[p] >= base[best]:
            dropped[p] = True
            continue
        if best >= 0:
            dropped[best] = True
        table[at] = p
    for p in range(total):
        if not dropped[p]:
            kept[used] = p
            used += 1
    return first_ints(kept, used)


@kernel
def root_of(above: Ints, row: int) -> int:
    """Lowest row of a row's component so far; halves the path on its way."""
    while above[row] != row:
        above[row] = above[above[row]]
        row = above[row]
    return row


@kernel
def joined_rows(indptr: Ints, column: Ints, cost: Floats, columns: int, held: Ints) -> Ints:
    """Lowest row of the component of each row [N]; -1 for a row without an allowed pair or without a parent."""
    n = len(held)
    above, first = ints_of(n, -1), ints_of(columns, -1)
    for row in range(n):
        if held[row] == 0:
            continue
        for e in range(indptr[row], indptr[row + 1]):
            if cost[e] == np.inf:
                continue
            if above[row] < 0:
                above[row] = row
            if first[column[e]] < 0:
                first[column[e]] = row
                continue
            a, b = root_of(above, row), root_of(above, first[column[e]])
            above[max(a, b)] = min(a, b)
    for row in range(n):
        if above[row] >= 0:
            above[row] = root_of(above, row)
    return above


@kernel
def rows_by_component(lowest: Ints) -> tuple[Ints, Ints]:
    """The rows of the components one after the other [A], and where each component's begin [C + 1]."""
    n = len(lowest)
    number, count = ints(n), 0
    size = ints_of(n + 1, 0)
    for row in range(n):
        if lowest[row] == row:
            number[row] = count
            count += 1
        if lowest[row] >= 0:
            size[number[lowest[row]] + 1] += 1
    start, place = ints_of(count + 1, 0), ints(count)
    for c in range(count):
        place[c] = start[c]
        start[c + 1] = start[c] + size[c + 1]
    rows = ints(start[count])
    for row in range(n):
        if lowest[row] >= 0:
            c = number[lowest[row]]
            rows[place[c]] = row
            place[c] += 1
    return rows, start


@kernel
def local_problem(indptr: Ints, column: Ints, cost: Floats, columns: int, lowest: Ints) -> Problem:
    """The allowed pairs, component by component; ``lowest``: see `joined_rows`."""
    rows, start = rows_by_component(lowest)
    width, local = ints_of(len(start) - 1, 0), ints_of(columns, -1)
    pair_start, pair_local = ints(len(rows) + 1), ints(len(column))
    pair_cost, pair_column = floats(len(column)), ints(len(column))
    used = 0
    for c in range(len(width)):
        for a in range(start[c], start[c + 1]):
            pair_start[a] = used
            for e in range(indptr[rows[a]], indptr[rows[a] + 1]):
                if cost[e] == np.inf:
                    continue
                y = column[e]
                if local[y] < 0:
                    local[y] = width[c]
                    width[c] += 1
                pair_local[used], pair_cost[used], pair_column[used] = local[y], cost[e], y
                used += 1
    pair_start[len(rows)] = used
    return Problem(rows, start, width, pair_start, pair_local, pair_cost, pair_column)


@kernel
def pieces_of(member: Bools, parents: Ints, rows: Ints, start: Ints, bits: Ints, word_start: Ints) -> Pieces:
    """The distinct pieces of all parents."""
    P, C, most, longest = len(parents), len(start) - 1, 0, 0
    for c in range(C):
        groups = P if word_start[c + 1] > word_start[c] else 1
        most += groups
        longest += groups * (start[c + 1] - start[c])
    component, begin = ints(most), ints_of(most + 1, 0)
    places, of_parent = ints(longest), int_table(P, C)
    table, named = new_table(P), ints(member.shape[0])
    count, used = 0, 0
    for c in range(C):
        low, high = word_start[c], word_start[c + 1]
        if high > low:
            for i in range(len(table)):
                table[i] = -1
        at, fresh = 0, True
        for i in range(P):
            p = parents[i]
            if high > low and (i == 0 or high > low + 1 or bits[p, low] != bits[parents[i - 1], low]):
                at = place_in(table, bits, p, low, high)
                fresh = table[at] < 0
            if fresh:
                table[at], named[p] = p, -1
                for place in range(start[c], start[c + 1]):
                    if member[p, rows[place]]:
                        places[used] = place
                        used += 1
                if used > begin[count]:
                    component[count], named[p] = c, count
                    count += 1
                    begin[count] = used
            fresh = False
            of_parent[i, c] = named[table[at]]
    component, begin, places = first_ints(component, count), first_ints(begin, count + 1), first_ints(places, used)
    return Pieces(component, begin, places, of_parent)
