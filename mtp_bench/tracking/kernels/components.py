"""Parts of an association problem that can be solved separately.

Rows of two components share no column, so that each component is a problem of its own.
Parents with the same rows of a component share its solutions: such a subset of rows is
a piece.
"""

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import part
from .tables import Pieces, Problem


@part
def root_of(above: Ints, row: int) -> int:
    """Find the lowest row of a component so far, halving paths."""
    while above[row] != row:
        above[row] = above[above[row]]
        row = above[row]
    return row


@part
def lowest_rows(indptr: Ints, column: Ints, columns: int) -> Ints:
    """Find the lowest row of each row's component [N], by union-find.

    It is -1 for a row without an allowed pair.
    """
    n = len(indptr) - 1
    above = np.full(n, -1)
    first_row = np.full(columns, -1)
    for row in range(n):
        for e in range(indptr[row], indptr[row + 1]):
            y = column[e]
            if above[row] < 0:
                above[row] = row
            if first_row[y] < 0:
                first_row[y] = row
                continue
            row_root = root_of(above, row)
            column_root = root_of(above, first_row[y])
            above[max(row_root, column_root)] = min(row_root, column_root)
    for row in range(n):
        if above[row] >= 0:
            above[row] = root_of(above, row)
    return above


@part
def rows_by_component(lowest_row: Ints) -> tuple[Ints, Ints]:
    """Group the rows that have a pair by component [A].

    The second array [C + 1] says where each component begins.
    """
    n = len(lowest_row)
    count = 0
    number = np.empty(n, np.int64)
    row_count = np.zeros(n, np.int64)
    for row in range(n):
        if lowest_row[row] == row:
            number[row] = count
            count += 1
        if lowest_row[row] >= 0:
            row_count[number[lowest_row[row]]] += 1
    row_start = np.zeros(count + 1, np.int64)
    next_place = np.empty(count, np.int64)
    for c in range(count):
        next_place[c] = row_start[c]
        row_start[c + 1] = row_start[c] + row_count[c]
    rows = np.empty(row_start[count], np.int64)
    for row in range(n):
        if lowest_row[row] >= 0:
            c = number[lowest_row[row]]
            rows[next_place[c]] = row
            next_place[c] += 1
    return rows, row_start


@part
def find_components(indptr: Ints, column: Ints, cost: Floats, columns: int) -> Problem:
    """Split the problem of `association.joint_k_best` into components."""
    rows, row_start = rows_by_component(lowest_rows(indptr, column, columns))
    column_count = np.zeros(len(row_start) - 1, np.int64)
    local_number = np.full(columns, -1)
    pair_start = np.empty(len(rows) + 1, np.int64)
    E = len(cost)
    pair_column = np.empty(E, np.int64)
    pair_cost = np.empty(E)
    caller_column = np.empty(E, np.int64)
    pair = 0
    for c in range(len(column_count)):
        for a in range(row_start[c], row_start[c + 1]):
            pair_start[a] = pair
            for e in range(indptr[rows[a]], indptr[rows[a] + 1]):
                y = column[e]
                if local_number[y] < 0:
                    local_number[y] = column_count[c]
                    column_count[c] += 1
                pair_column[pair] = local_number[y]
                pair_cost[pair] = cost[e]
                caller_column[pair] = y
                pair += 1
    pair_start[len(rows)] = pair
    return Problem(
        rows, row_start, column_count, pair_start, pair_column, pair_cost, caller_column
    )


@part
def find_pieces(member: Bools, rows: Ints, row_start: Ints) -> Pieces:
    """Find the distinct pieces of all parents."""
    P = member.shape[0]
    C = len(row_start) - 1
    component = np.empty(P * C, np.int64)
    first_parent = np.empty(P * C, np.int64)
    piece_start = np.zeros(P * C + 1, np.int64)
    places = np.empty(P * len(rows), np.int64)
    of_parent = np.empty((P, C), np.int64)
    count = 0
    place_count = 0
    for c in range(C):
        low = row_start[c]
        high = row_start[c + 1]
        first_piece = count
        for p in range(P):
            # the first piece with the rows of this parent
            q = first_piece
            place = low
            while q < count and place < high:
                if member[p, rows[place]] == member[first_parent[q], rows[place]]:
                    place += 1
                else:
                    q = q + 1
                    place = low
            of_parent[p, c] = q
            if q < count:
                continue
            for place in range(low, high):
                if member[p, rows[place]]:
                    places[place_count] = place
                    place_count += 1
            if place_count == piece_start[count]:
                of_parent[p, c] = -1
                continue
            component[count] = c
            first_parent[count] = p
            count += 1
            piece_start[count] = place_count
    return Pieces(
        component[:count], piece_start[: count + 1], places[:place_count], of_parent
    )
