"""The search for parameters whose simulated figures are those of a real detector."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....types import Floats

_STEP = 0.25  # of every unknown, for slopes: simulated figures are not smooth
_PRIOR = 0.15  # pull towards the start, for what the figures do not tell
_FARTHEST = 4.5  # unknowns are log-odds or logarithms
_LONGEST = 1.0  # of a step


def nearest(figures: Callable[[Floats], Floats], real: Floats, scale: Floats, start: Floats, rounds: int) -> Floats:
    """Unknowns whose ``figures`` are nearest to the ``real`` ones, in units of ``scale``: damped Gauss-Newton.

    A figure that is NaN in reality does not count.
    """
    known = np.isfinite(real)

    def loss(unknown: Floats) -> Floats:
        off = (np.nan_to_num(figures(unknown)) - real)[known] / scale[known]
        return np.concatenate([off, _PRIOR * (unknown - start)])

    unknown, best, least = start, start, np.inf
    for _ in range(rounds):
        now = loss(unknown)
        if float(now @ now) < least:
            best, least = unknown, float(now @ now)
        slope = np.empty((len(now), len(unknown)))
        for i in range(len(unknown)):
            moved = unknown.copy()
            moved[i] += _STEP
            slope[:, i] = (loss(moved) - now) / _STEP
        step = np.linalg.solve(slope.T @ slope + np.eye(len(unknown)), -slope.T @ now)
        unknown = np.clip(unknown + np.clip(step, -_LONGEST, _LONGEST), -_FARTHEST, _FARTHEST)
    now = loss(unknown)
    return unknown if float(now @ now) < least else best


def odds(log: float) -> float:
    """A share from its log-odds."""
    return float(1.0 / (1.0 + np.exp(-log)))
