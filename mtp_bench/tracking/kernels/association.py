"""The joint k-best association: pieces solved once each, then merged over all parents."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .arrays import floats, floats_of, int_table, ints, ints_of, up_to
from .checks import OK, at_most, check
from .compile import kernel
from .components import distinct_parents, joined_rows, local_problem, packed_rows, pieces_of, rows_held
from .merge import merge
from .pieces import solve_pieces
from .write import Parents, sort_solutions, write_clusters, write_solutions

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

    The first seven arguments are those of `joint.joint_k_best`. If not ``joint``: costs [H, C, k] of the best solutions
    of each cluster, row_to_column [H, k, N], cluster [N]; the first two flat in their first dimensions. A piece of at
    most ``most_choices`` choices is enumerated. One kernel for both is half as long to compile.
    """
    error, where, scale = check(indptr, column, cost, columns, base_cost)
    H, N = member.shape
    if error != OK or k < 1 or H == 0:
        return error, where, floats(0), int_table(0, N), ints_of(N if not joint else 0, -1)
    if joint:
        k = at_most(indptr, member, k)
    held = rows_held(member)
    lowest = joined_rows(indptr, column, cost, columns, held)
    problem = local_problem(indptr, column, cost, columns, lowest)
    bits, word_start = packed_rows(member, held, problem.rows, problem.start, lowest)
    parents = distinct_parents(bits, base_cost) if joint else up_to(H)
    P = len(parents)
    base = floats(P)
    for p in range(P):
        base[p] = base_cost[parents[p]]
    pieces = pieces_of(member, parents, problem.rows, problem.start, bits, word_start)
    solutions, total, limit = solve_pieces(k, problem, pieces, base, scale, joint, most_choices)
    if not joint:
        costs = floats_of(H * pieces.of_parent.shape[1] * k, np.inf)
        cluster, row_to_column = ints_of(N, -1), int_table(H * k, N)
        write_clusters(k, problem, pieces, solutions, costs, cluster, row_to_column)
        return error, where, costs, row_to_column, cluster
    chosen, states = merge(pieces, solutions, total, limit, k)
    costs, parent, row_to_column = floats(len(chosen)), ints(len(chosen)), int_table(len(chosen), N)
    room = Parents(int_table(P, N), int_table(P, N + 1), ints_of(P, -1))
    write_solutions(chosen, states, problem, pieces, solutions, base, room, costs, row_to_column)
    for i in range(len(chosen)):
        parent[i] = parents[states.parent[chosen[i]]]
    costs, parent, row_to_column = sort_solutions(costs, parent, row_to_column)
    return error, where, costs, row_to_column, parent
