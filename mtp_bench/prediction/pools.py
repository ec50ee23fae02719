"""Pools of samples in the form of the samplers' kernels."""

import numpy as np

from ..core import Floats, Ints
from ..tracking import part


@part
def existing(log_weight: Floats, rows: Ints) -> int:
    """Write the indices of the samples with a finite log-weight [S] to ``rows`` [S]; return how many."""
    n = 0
    for s in range(len(log_weight)):
        if np.isfinite(log_weight[s]):
            rows[n] = s
            n += 1
    return n


@part
def pass_on(
    points: Floats,
    log_weight: Floats,
    rows: Ints,
    n: int,
    chosen: Floats,
    chosen_log_weight: Floats,
) -> None:
    """Copy the ``n`` samples in ``rows`` to the first rows of ``chosen`` [k, d]; mark the others absent."""
    for j in range(len(chosen)):
        for axis in range(chosen.shape[1]):
            chosen[j, axis] = points[rows[j], axis] if j < n else 0.0
        chosen_log_weight[j] = log_weight[rows[j]] if j < n else -np.inf


@part
def masses(log_weight: Floats, rows: Ints, n: int, mass: Floats) -> float:
    """Log of the total weight of the ``n`` samples in ``rows``; writes normalised weights to ``mass`` [n].

    Weights are relative to the heaviest: an object of unlikely hypotheses alone must not vanish by underflow.
    """
    heaviest, total = -np.inf, 0.0
    for i in range(n):
        heaviest = max(heaviest, log_weight[rows[i]])
    for i in range(n):
        mass[i] = np.exp(log_weight[rows[i]] - heaviest)
        total += mass[i]
    for i in range(n):
        mass[i] /= total
    return float(heaviest + np.log(total))


def as_points(pool: Floats, log_weight: Floats) -> tuple[Floats, Floats]:
    """The pool [O, S, T, 2] as points [O, S, 2 T] and its log-weights [O, S], contiguous and writable for kernels."""
    points = np.require(
        pool.reshape(*pool.shape[:2], 2 * pool.shape[2]), np.float64, ["C", "W"]
    )
    return points, np.require(log_weight, np.float64, ["C", "W"])
