"""Arrays in which the kernels solve one piece after the other."""

from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, part
from .tables import Block, Choices, Matching, Path, Pieces, Problem


class Workspace(NamedTuple):
    """Arrays for one piece at a time."""

    pair_start: Ints
    pair_end: Ints
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
    """Make few arrays for the largest piece, since each takes time."""
    n = 1
    m = 1
    for q in range(len(pieces.component)):
        n = max(n, pieces.row_start[q + 1] - pieces.row_start[q])
        m = max(m, problem.column_count[pieces.component[q]])
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
        np.zeros(len(problem.pair_cost), np.bool_),
        Matching(rows[2], columns[0], row_sums[0], column_sums[0], row_out, column_out),
        Path(column_sums[1], columns[1], columns[2], columns[3], np.zeros(3, np.int64)),
        Choices(column_out, rows[3], row_sums[1], row_sums[2]),
        np.empty(k, np.int64),
        np.empty(k),
    )


@part
def new_roots(problem: Problem, pieces: Pieces) -> Roots:
    """Make arrays for the cheapest solution of every piece."""
    Q = len(pieces.component)
    row_count = len(pieces.places)
    v_start = np.zeros(Q + 1, np.int64)
    for q in range(Q):
        v_start[q + 1] = v_start[q] + problem.column_count[pieces.component[q]]
    return Roots(
        np.empty(row_count, np.int64),
        np.empty(row_count),
        np.empty(v_start[Q]),
        v_start,
        np.empty(Q),
    )


@inlined
def load_piece(q: int, problem: Problem, pieces: Pieces, space: Workspace) -> Block:
    """Number the rows and columns of piece ``q`` from 0."""
    start = pieces.row_start[q]
    end = pieces.row_start[q + 1]
    pair_start = space.pair_start
    pair_end = space.pair_end
    for i in range(start, end):
        place = pieces.places[i]
        pair_start[i - start] = problem.pair_start[place]
        pair_end[i - start] = problem.pair_start[place + 1]
    return Block(
        end - start,
        problem.column_count[pieces.component[q]],
        pair_start,
        pair_end,
        problem.pair_column,
        problem.pair_cost,
        space.banned,
    )
