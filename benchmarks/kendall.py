"""Kendall's tau between many orders at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


def kendall_tau(first: Array, second: Array) -> Array:
    """Kendall's tau-b [B] over the agents of each column of ``first`` and ``second`` [A, B]; 0 for constant columns."""
    i, j = np.triu_indices(len(first), 1)
    a, b = np.sign(first[i] - first[j]), np.sign(second[i] - second[j])
    size = np.sqrt((a != 0).sum(0) * (b != 0).sum(0))
    return np.asarray((a * b).sum(0) / np.maximum(size, 1e-9))
