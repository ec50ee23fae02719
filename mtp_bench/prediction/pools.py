"""Pools of samples in the form of the samplers' kernels."""

import numpy as np

from ..core import Floats, Ints
from ..tracking import part


@part
def existing(log_weight: Floats, rows: Ints) -> int:
    """Write indices of the samples with a finite log-weight [S] to ``rows`` [S].

    Returns how many there are.
    """
    count = 0
    for sample in range(len(log_weight)):
        if np.isfinite(log_weight[sample]):
            rows[count] = sample
            count += 1
    return count


@part
def pass_on(
    points: Floats,
    log_weight: Floats,
    rows: Ints,
    count: int,
    chosen: Floats,
    chosen_log_weight: Floats,
) -> None:
    """Copy the ``count`` samples in ``rows`` to the first rows of ``chosen`` [k, d].

    The other rows are marked absent.
    """
    for j in range(len(chosen)):
        if j < count:
            chosen_log_weight[j] = log_weight[rows[j]]
        else:
            chosen_log_weight[j] = -np.inf
        for axis in range(chosen.shape[1]):
            chosen[j, axis] = points[rows[j], axis] if j < count else 0.0


@part
def masses(log_weight: Floats, rows: Ints, count: int, mass: Floats) -> float:
    """Return the log of the total weight of the ``count`` samples in ``rows``.

    Writes normalised weights to ``mass`` [count]. Weights are relative to the heaviest:
    an object of unlikely hypotheses alone must not vanish by underflow.
    """
    heaviest = -np.inf
    for i in range(count):
        heaviest = max(heaviest, log_weight[rows[i]])
    total = 0.0
    for i in range(count):
        mass[i] = np.exp(log_weight[rows[i]] - heaviest)
        total += mass[i]
    for i in range(count):
        mass[i] /= total
    return float(heaviest + np.log(total))


def as_points(pool: Floats, log_weight: Floats) -> tuple[Floats, Floats]:
    """Return the pool [O, S, T, 2] as points [O, S, 2 T], and its log-weights [O, S].

    Both are contiguous and writable for kernels.
    """
    flat = pool.reshape(*pool.shape[:2], 2 * pool.shape[2])
    points = np.require(flat, np.float64, ["C", "W"])
    return points, np.require(log_weight, np.float64, ["C", "W"])
