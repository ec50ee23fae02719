"""Pools of samples as the kernels of all samplers read them: which samples exist, and pools that need no reduction."""

from __future__ import annotations

import numpy as np

from ..tracking.kernels.compile import kernel
from ..types import Floats, Ints


@kernel("i8(f8[::1], i8[::1])")
def existing(log_weight: Floats, there: Ints) -> int:
    """How many samples have a finite log-weight [S]; their places are written to ``there`` [S]."""
    n = 0
    for s in range(len(log_weight)):
        if np.isfinite(log_weight[s]):
            there[n] = s
            n += 1
    return n


@kernel("void(f8[:, ::1], f8[::1], i8[::1], i8, f8[:, ::1], f8[::1])")
def pass_on(points: Floats, log_weight: Floats, there: Ints, n: int, chosen: Floats, chosen_log_weight: Floats) -> None:
    """The ``n`` samples at ``there`` as they are, the first rows of ``chosen`` [k, d]; the others do not exist."""
    for j in range(len(chosen)):
        for axis in range(chosen.shape[1]):
            chosen[j, axis] = points[there[j], axis] if j < n else 0.0
        chosen_log_weight[j] = log_weight[there[j]] if j < n else -np.inf


@kernel("f8(f8[::1], i8[::1], i8, f8[::1])")
def masses(log_weight: Floats, there: Ints, n: int, mass: Floats) -> float:
    """Weights [n] that sum to 1 of the ``n`` samples at ``there``; the logarithm of what they summed to.

    Relative to the heaviest: an object that only unlikely hypotheses hold must not vanish by underflow.
    """
    heaviest, total = -np.inf, 0.0
    for i in range(n):
        heaviest = max(heaviest, log_weight[there[i]])
    for i in range(n):
        mass[i] = np.exp(log_weight[there[i]] - heaviest)
        total += mass[i]
    for i in range(n):
        mass[i] /= total
    return float(heaviest + np.log(total))
