"""Greedy association, as AB3DMOT uses it for pedestrians and on nuScenes."""

from __future__ import annotations

import numpy as np

from ..types import Floats, Ints
from .k_best import k_best
from .parameters import ClassParameters


def greedy_where_asked(cost: Floats, class_id: Ints, parameters: tuple[ClassParameters, ...]) -> Ints:
    """Column of each row, -1 for none: cheapest pair first for greedy classes, least total cost for the others."""
    column = np.full(len(cost), -1, dtype=np.int64)
    for c, rule in enumerate(parameters):
        rows = np.flatnonzero(class_id == c)
        if rule.assignment == "hungarian":
            column[rows] = k_best(cost[rows], 1)[1][0]
            continue
        left = cost[rows].copy()
        while left.size and np.isfinite(left.min()):
            i, j = np.unravel_index(np.argmin(left), left.shape)
            column[rows[i]] = j
            left[i, :] = left[:, j] = np.inf
    return column
