"""The mean of a latent number of which only the higher part is seen, by maximum likelihood.

An object's quality is known where it is detected, from the score; where it is not, it is below the lowest one.
"""

from __future__ import annotations

import numpy as np

from ....types import Floats, Ints
from ..skewed import below, density

_LEAST_STEP = 1e-4  # between two cuts
_RIDGE = 1.0  # inverse variance of a weight around 0; keeps a feature that never occurs at 0
_TINY = 1e-12


def ordered_levels(feature: Floats, level: Ints, levels: int, lapses: float) -> tuple[Floats, Floats]:
    """Weights ``[n]`` of the mean over ``feature`` ``[R, n]``, and cuts ``[levels - 1]``.

    ``level`` ``[R]`` 0, 1, ... is the number of cuts below a number of variance 1 whose lower tail has the share
    ``lapses``; the first cut is 0.
    """
    from scipy.optimize import minimize
    from scipy.special import ndtri

    share = np.cumsum(np.bincount(level, minlength=levels))[:-1] / len(level)
    start = ndtri(np.clip(share, 1e-3, 1 - 1e-3))
    gaps = np.log(np.maximum(np.diff(start), 1e-2))
    weight = np.zeros(feature.shape[1])
    weight[0] = -start[0]
    known = np.concatenate([weight, gaps])
    of = feature, level, lapses
    answer = minimize(_loss, known, args=of, jac=True, method="L-BFGS-B", options={"maxiter": 1000})
    weight, gaps = np.split(answer.x, [feature.shape[1]])
    return weight, np.concatenate([[0.0], np.cumsum(np.exp(gaps) + _LEAST_STEP)])


def _loss(known: Floats, feature: Floats, level: Ints, lapses: float) -> tuple[float, Floats]:
    """Mean negative log-likelihood and its gradient over weights and logarithms of the gaps between cuts."""
    weight, gaps = np.split(known, [feature.shape[1]])
    cut = np.concatenate([[-1e3, 0.0], np.cumsum(np.exp(gaps) + _LEAST_STEP), [1e3]])
    mean = feature @ weight
    low, high = cut[level] - mean, cut[level + 1] - mean
    # of the mirrored number, whose upper tail is the long one
    chance = np.maximum(below(-low, lapses) - below(-high, lapses), _TINY)
    at_low, at_high = (density(-x, lapses) / chance for x in (low, high))
    of_weight = feature.T @ (at_high - at_low)
    of_cut = np.bincount(level, at_low, len(cut)) - np.bincount(level + 1, at_high, len(cut))
    of_gaps = np.cumsum(of_cut[2:-1][::-1])[::-1] * np.exp(gaps)
    penalty = 0.5 * _RIDGE * float(weight[1:] @ weight[1:])
    of_weight[1:] += _RIDGE * weight[1:]
    count = len(level)
    return (penalty - float(np.log(chance).sum())) / count, np.concatenate([of_weight, of_gaps]) / count
