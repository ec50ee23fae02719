"""Room for the piece that is being solved, made once, and for the cheapest solutions of all pieces.

Kernels that work on a piece take a `Space` and make their records of its rows, which costs nothing there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import flags, float_table, floats, int_table, ints, ints_of
from .compile import kernel
from .tables import Choices, Matching, Path, Piece, Pieces, Problem


class Space(NamedTuple):
    """Room for one piece at a time, whichever it is; few arrays, for each takes time to hand over."""

    of_row: Ints  # [4, n]
    of_column: Ints  # [4, m]
    sums_of_row: Floats  # [3, n + 1]
    sums_of_column: Floats  # [2, m]
    row_out: Bools  # [n]
    column_out: Bools  # [m]
    hub: Ints  # [3]
    banned: Bools  # [E]
    order: Ints  # [k]
    cost: Floats  # [k]


@kernel
def largest(pieces: Pieces, width: Ints) -> tuple[int, int]:
    """Rows and columns of the largest pieces, at least 1."""
    n, m = 1, 1
    for q in range(len(pieces.component)):
        n, m = max(n, pieces.begin[q + 1] - pieces.begin[q]), max(m, width[pieces.component[q]])
    return n, m  # pyright: ignore[reportReturnType]


@kernel
def new_space(n: int, m: int, k: int, pairs: int) -> Space:
    """Room for pieces of up to ``n`` rows and ``m`` columns."""
    sums_of_column = float_table(2, m)
    for y in range(m):
        sums_of_column[1, y] = np.inf
    return Space(
        int_table(4, n), int_table(4, m), float_table(3, n + 1), sums_of_column, flags(n), flags(m),
        ints_of(3, 0), flags(pairs), ints(k), floats(k),
    )  # fmt: skip


@kernel(inline=True)
def piece_in(space: Space, q: int, problem: Problem, pieces: Pieces) -> Piece:
    """Piece ``q``, with its rows and columns numbered from 0."""
    low, high = pieces.begin[q], pieces.begin[q + 1]
    first, last = space.of_row[0], space.of_row[1]
    for i in range(low, high):
        place = pieces.places[i]
        first[i - low], last[i - low] = problem.pair_start[place], problem.pair_start[place + 1]
    width = problem.width[pieces.component[q]]
    rows = high - low
    return Piece(rows, width, first, last, problem.pair_local, problem.pair_cost, space.banned)  # pyright: ignore[reportArgumentType]


@kernel(inline=True)
def matching_in(space: Space) -> Matching:
    """Room for a matching."""
    match, owner, u, v = space.of_row[2], space.of_column[0], space.sums_of_row[0], space.sums_of_column[0]
    return Matching(match, owner, u, v, space.row_out, space.column_out)


@kernel(inline=True)
def path_in(space: Space) -> Path:
    """Room for a path."""
    return Path(space.sums_of_column[1], space.of_column[1], space.of_column[2], space.of_column[3], space.hub)


@kernel(inline=True)
def choices_in(space: Space) -> Choices:
    """Room for a partial choice."""
    return Choices(space.column_out, space.of_row[3], space.sums_of_row[1], space.sums_of_row[2])


class Roots(NamedTuple):
    """The cheapest solution of every piece."""

    pair: Ints  # of each row, in the order of `Pieces.places`
    u: Floats  # potential of each row, in that order
    v: Floats  # potentials of the columns of each piece
    v_start: Ints  # [Q + 1] where those begin
    cost: Floats  # [Q]


@kernel
def new_roots(component: Ints, rows: int, width: Ints) -> Roots:
    """Room for the cheapest solution of every piece."""
    Q = len(component)
    v_start = ints_of(Q + 1, 0)
    for q in range(Q):
        v_start[q + 1] = v_start[q] + width[component[q]]
    return Roots(ints(rows), floats(rows), floats(v_start[Q]), v_start, floats(Q))


@kernel
def load_root(q: int, piece: Piece, begin: int, roots: Roots, matching: Matching) -> None:
    """The cheapest solution of piece ``q`` and its potentials, as a matching."""
    for x in range(piece.n):
        matching.match[x], matching.u[x] = roots.pair[begin + x], roots.u[begin + x]
    for y in range(piece.m):
        matching.v[y] = roots.v[roots.v_start[q] + y]
