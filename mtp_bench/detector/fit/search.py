"""Search for parameters whose simulated figures are nearest to those of a real detector."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...types import Floats

_STEP = 0.25  # of every unknown, for slopes: simulated figures are not smooth
_PRIOR = 0.15  # pull towards the start, for unknowns that the figures do not determine
_FARTHEST = 4.5  # unknowns are log-odds or logarithms
_LONGEST = 1.0  # step


def nearest_parameters(
    figures: Callable[[Floats], Floats], real: Floats, scale: Floats, start: Floats, rounds: int
) -> Floats:
    """Unknowns with ``figures`` nearest to the ``real`` ones, in units of ``scale``: damped Gauss-Newton.

    A real figure of NaN does not count.
    """
    finite = np.isfinite(real)

    def loss(unknown: Floats) -> Floats:
        difference = (np.nan_to_num(figures(unknown)) - real)[finite] / scale[finite]
        return np.concatenate([difference, _PRIOR * (unknown - start)])

    unknown, best, least = start, start, np.inf
    for _ in range(rounds):
        current = loss(unknown)
        if float(current @ current) < least:
            best, least = unknown, float(current @ current)
        slope = np.empty((len(current), len(unknown)))
        for i in range(len(unknown)):
            moved = unknown.copy()
            moved[i] += _STEP
            slope[:, i] = (loss(moved) - current) / _STEP
        step = np.linalg.solve(slope.T @ slope + np.eye(len(unknown)), -slope.T @ current)
        unknown = np.clip(unknown + np.clip(step, -_LONGEST, _LONGEST), -_FARTHEST, _FARTHEST)
    current = loss(unknown)
    return unknown if float(current @ current) < least else best


def from_log_odds(log_odds: float) -> float:
    """Share with these log-odds."""
    return float(1.0 / (1.0 + np.exp(-log_odds)))
