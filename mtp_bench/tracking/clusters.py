"""Hypotheses per cluster: every cluster of tracks gets alternatives of its own, all at once.

In a crowd the cheapest global hypotheses differ in one or two places only. Clusters, which share no detection, are
independent: one hypothesis can hold the second choice of all of them. The best hypothesis is the same.
"""

from __future__ import annotations

import numpy as np

from ..types import Bools, Floats, Ints
from .joint import cluster_k_best


def per_cluster(
    indptr: Ints, column: Ints, cost: Floats, columns: int, member: Bools, base_cost: Floats, k: int
) -> tuple[Floats, Ints, Ints]:
    """Costs [k'], row_to_column [k', N] and parent [k'], cheapest first; arguments as of `joint_k_best`.

    Child i of a parent takes the i-th best solution of every cluster (the best of those that have fewer); of all
    children of all parents the ``k`` cheapest stay. The first is the first of `joint_k_best`.
    """
    found = cluster_k_best(indptr, column, cost, columns, member, base_cost, k)
    known = np.isfinite(found.cost)  # [H, C, k]
    total = base_cost[:, None] + np.where(known, found.cost, found.cost[:, :, :1]).sum(axis=1)
    differs = np.asarray(known.any(axis=1))
    differs[:, 0] = True  # also without a cluster
    parent, child = np.nonzero(differs)
    order = np.argsort(total[parent, child], kind="stable")[:k]
    parent, child = parent[order], child[order]
    return total[parent, child], found.row_to_column[parent, child], parent
