"""Parts of an association problem that can be solved separately: components, and the pieces that parents have of them.

Rows of two components share no column, so that each component is a problem of its own. Parents with the same rows of a
component share its solutions: such a subset of rows is a piece.
"""

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import part
from .tables import Pieces, Problem


@part
def root_of(above: Ints, row: int) -> int:
    """Lowest row of a row's component so far; halves the path on its way."""
    while above[row] != row:
        above[row] = above[above[row]]
        row = above[row]
    return row


@part
def lowest_rows(indptr: Ints, column: Ints, columns: int) -> Ints:
    """Lowest row of the component of each row [N], by union-find; -1 for a row without an allowed pair."""
    n = len(indptr) - 1
    above = np.full(n, -1)
    first = np.full(columns, -1)
    for row in range(n):
        for e in range(indptr[row], indptr[row + 1]):
            if above[row] < 0:
                above[row] = row
            if first[column[e]] < 0:
                first[column[e]] = row
                continue
            a = root_of(above, row)
            b = root_of(above, first[column[e]])
            above[max(a, b)] = min(a, b)
    for row in range(n):
        if above[row] >= 0:
            above[row] = root_of(above, row)
    return above


@part
def rows_by_component(lowest: Ints) -> tuple[Ints, Ints]:
    """Rows that have a pair, grouped by component [A], and the index at which each component begins [C + 1]."""
    n = len(lowest)
    count = 0
    number = np.empty(n, np.int64)
    size = np.zeros(n, np.int64)
    for row in range(n):
        if lowest[row] == row:
            number[row] = count
            count += 1
        if lowest[row] >= 0:
            size[number[lowest[row]]] += 1
    start = np.zeros(count + 1, np.int64)
    place = np.empty(count, np.int64)
    for c in range(count):
        place[c] = start[c]
        start[c + 1] = start[c] + size[c]
    rows = np.empty(start[count], np.int64)
    for row in range(n):
        if lowest[row] >= 0:
            c = number[lowest[row]]
            rows[place[c]] = row
            place[c] += 1
    return rows, start


@part
def find_components(indptr: Ints, column: Ints, cost: Floats, columns: int) -> Problem:
    """The problem of `association.joint_k_best`, split into components."""
    rows, start = rows_by_component(lowest_rows(indptr, column, columns))
    width = np.zeros(len(start) - 1, np.int64)
    local = np.full(columns, -1)
    first = np.empty(len(rows) + 1, np.int64)
    used = 0
    E = len(cost)
    local_column = np.empty(E, np.int64)
    local_cost = np.empty(E)
    column_of_caller = np.empty(E, np.int64)
    for c in range(len(width)):
        for a in range(start[c], start[c + 1]):
            first[a] = used
            for e in range(indptr[rows[a]], indptr[rows[a] + 1]):
                y = column[e]
                if local[y] < 0:
                    local[y] = width[c]
                    width[c] += 1
                local_column[used] = local[y]
                local_cost[used] = cost[e]
                column_of_caller[used] = y
                used += 1
    first[len(rows)] = used
    return Problem(
        rows, start, width, first, local_column, local_cost, column_of_caller
    )


@part
def find_pieces(member: Bools, rows: Ints, start: Ints) -> Pieces:
    """The distinct pieces of all parents."""
    P = member.shape[0]
    C = len(start) - 1
    component = np.empty(P * C, np.int64)
    origin = np.empty(P * C, np.int64)
    begin = np.zeros(P * C + 1, np.int64)
    places = np.empty(P * len(rows), np.int64)
    of_parent = np.empty((P, C), np.int64)
    count = 0
    used = 0
    for c in range(C):
        low = start[c]
        high = start[c + 1]
        earlier = count
        for p in range(P):
            q = earlier
            place = low
            while (
                q < count and place < high
            ):  # the first piece with the rows of this parent
                if member[p, rows[place]] == member[origin[q], rows[place]]:
                    place += 1
                else:
                    q = q + 1
                    place = low
            of_parent[p, c] = q
            if q < count:
                continue
            for place in range(low, high):
                if member[p, rows[place]]:
                    places[used] = place
                    used += 1
            if used == begin[count]:
                of_parent[p, c] = -1
                continue
            component[count] = c
            origin[count] = p
            count += 1
            begin[count] = used
    return Pieces(component[:count], begin[: count + 1], places[:used], of_parent)
