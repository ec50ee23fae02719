"""Records of arrays that the kernels of the association hand to each other.

README.md explains the words.
"""

from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats, Ints
from .compile import inlined, part


class Problem(NamedTuple):
    """Assignment problem of the allowed pairs, split into components.

    Each component numbers its columns from 0.
    """

    rows: Ints  # [A] the caller's rows that have a pair
    row_start: Ints  # [C + 1] where the rows of each component begin
    column_count: Ints  # [C] of each component
    pair_start: Ints  # [A + 1] where the pairs of each row begin
    pair_column: Ints  # [E] column of each pair in its component
    pair_cost: Floats  # [E]
    caller_column: Ints  # [E]


class Pieces(NamedTuple):
    """Distinct subsets of the rows of a component that parents hold."""

    component: Ints  # [Q]
    row_start: Ints  # [Q + 1] where the rows of each piece begin in ``places``
    places: Ints  # rows of the pieces, as indices into `Problem.rows`
    of_parent: Ints  # [P, C] piece of a parent in a component, -1: it has no row there


class Solutions(NamedTuple):
    """The solutions of all pieces, the cheapest of each piece first."""

    first: Ints  # [Q] number of the first solution of each piece
    solution_count: Ints  # [Q]
    gap: Floats  # by solution: how much dearer than the first of its piece
    pair_start: Ints  # by solution: where its pairs begin in ``pairs``
    pairs: Ints  # the pair of each row of the piece, -1: unmatched


class Block(NamedTuple):
    """The pairs of one piece, with rows and columns numbered from 0."""

    n: int  # rows
    m: int  # columns
    pair_start: Ints  # [n] first pair of each row
    pair_end: Ints  # [n] the one after its last
    pair_column: Ints  # [E]
    pair_cost: Floats  # [E]
    banned: Bools  # [E] pairs that Murty's search forbids at the moment


class Matching(NamedTuple):
    """Matching of the rows and columns of a piece, with its dual potentials."""

    match: Ints  # [n] pair of each row, -1: unmatched
    owner: Ints  # [m] row of each column, -1: unmatched
    u: Floats  # [n] potentials of rows
    v: Floats  # [m] of columns
    row_out: Bools  # [n] rows that take no part
    column_out: Bools  # [m] columns that take no part


class Path(NamedTuple):
    """Columns that a search for the shortest alternating path has reached."""

    distance: Floats  # [m] infinite between searches
    via_pair: Ints  # [m] the pair by which a column was reached, -1: from the hub
    via_row: Ints  # [m] the row, -1: the hub
    reached: Ints  # [m] the columns reached, those that are closed first
    # [3] row and column that the hub was reached from, -1: none; columns reached
    hub: Ints


class Choices(NamedTuple):
    """The partial choice of an enumeration."""

    column_used: Bools  # [m]
    option: Ints  # [n] pair of each row so far; `Block.pair_end`: unmatched
    lower_bound: Floats  # [n + 1] of the rise over the cheapest solution after each row
    total_cost: Floats  # [n + 1] so far


class Ranking(NamedTuple):
    """The at most k best solutions of a piece so far."""

    order: Ints  # [k] their numbers, cheapest first
    cost: Floats  # [k] by number
    pairs: Ints  # n pairs of each, the first from number ``start`` on
    start: int


class Bound(NamedTuple):
    """The k least totals known of the whole problem.

    A dearer solution of a piece cannot matter.
    """

    best: Floats  # [k] increasing
    # total of the cheapest solution of each parent of the piece, increasing
    totals: Floats
    parent_count: int  # how many those are
    slack: float  # for rounding


class States(NamedTuple):
    """Changes of cheapest solutions, each of one piece more than its ``previous``."""

    parent: Ints
    # that it changes, -1: none; during the merge its number in the parent's order
    piece: Ints
    rank: Ints  # of the solution that the piece takes; 0: the state changes nothing
    previous: Ints  # -1: none


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
