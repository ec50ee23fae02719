"""The joint k-best association: pieces solved once each, then merged over all parents."""

from __future__ import annotations

from ...types import Bools, Floats, Ints
from .arrays import floats, int_table, ints_of, up_to
from .checks import OK, at_most, check
from .compile import kernel
from .components import distinct_parents, joined_rows, local_problem, packed_rows, pieces_of, rows_held
from .merge import merge
from .pieces import solve_pieces
from .write import sort_solutions, write_clusters, write_solutions

MOST_CHOICES = 10**7  # of a piece that is enumerated as long as patience lasts


@kernel("Tuple((i8, i8, f8[::1], i8[:,::1], i8[::1]))(i8[::1], i8[::1], f8[::1], i8, b1[:,::1], f8[::1], i8, b1, i8)")
def search(
    indptr: Ints,
    column: Ints,
    cost: Floats,
    columns: int,
    member: Bools,
    base_cost: Floats,
    k: int,
    joint: bool,
    most_choices: int,
) -> tuple[int, int, Floats, Ints, Ints]:
    """What is wrong with the input and where; then costs [k'], row_to_column [k', N] and parent [k'], best first.

    If not ``joint``: costs [H, C, k] of the best solutions of each cluster, row_to_column [H, k, N], cluster [N]; the
    first two flat in their first dimensions. A piece of at most ``most_choices`` is enumerated. One
    kernel for both is half as long to compile.
    """
    error, where, scale = check(indptr, column, cost, columns, base_cost)
    H, N = member.shape
    if error != OK or k < 1 or H == 0:
        return error, where, floats(0), int_table(0, N), ints_of(N if not joint else 0, -1)
    if joint:
        k = at_most(indptr, member, k)
    held = rows_held(member)
    lowest = joined_rows(indptr, column, cost, columns, held)
    rows, start, width, pair_start, pair_local, pair_cost, pair_column = local_problem(
        indptr, column, cost, columns, lowest
    )
    bits, word_start = packed_rows(member, held, rows, start, lowest)
    parents = distinct_parents(bits, base_cost) if joint else up_to(H)
    P = len(parents)
    base = floats(P)
    for p in range(P):
        base[p] = base_cost[parents[p]]
    component, begin, places, piece_of = pieces_of(member, parents, rows, start, bits, word_start)
    sol_begin, sol_count, root_cost, gap, pair_at, pairs, total, limit = solve_pieces(
        k,
        component,
        begin,
        places,
        piece_of,
        width,
        pair_start,
        pair_local,
        pair_cost,
        base,
        scale,
        joint,
        most_choices,
    )
    if not joint:
        cluster, row_to_column = ints_of(N, -1), int_table(H * k, N)
        costs = write_clusters(
            k, start, pair_column, begin, places, rows, piece_of, sol_begin, sol_count, root_cost, gap, pair_at, pairs,
            cluster, row_to_column,
        )  # fmt: skip
        return error, where, costs, row_to_column, cluster
    parent, state, piece, rank, under = merge(piece_of, component, sol_begin, sol_count, gap, total, limit, k)
    costs, row_to_column = floats(len(parent)), int_table(len(parent), N)
    write_solutions(
        parent, state, piece, rank, under, parents, base, rows, pair_cost, pair_column, begin, places, piece_of,
        sol_begin, pair_at, pairs, costs, row_to_column,
    )  # fmt: skip
    costs, parent, row_to_column = sort_solutions(costs, parent, row_to_column)
    return error, where, costs, row_to_column, parent
