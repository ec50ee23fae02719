"""Chance that an object is undetected, fitted: regularised logistic regressions on what the sensor sees of it."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats
from ..profile import UndetectedNoise
from .samples import ObjectSamples

_RIDGE = 1.0  # inverse variance of a weight around its prior; keeps a feature that never occurs at the prior
_STEPS = 50


def fit_undetected(objects: ObjectSamples) -> UndetectedNoise:
    """Log-odds of being undetected in an object's first frame, and in later ones with the memory of the frame before.

    First frames are few, one per object: their weights are drawn towards those of all frames.
    """
    undetected = ~objects.hit
    earlier, later = objects.pairs()
    first = np.ones(len(undetected), dtype=bool)
    first[later] = False
    everywhere = logistic(objects.feature, undetected, np.zeros(6))
    with_memory = np.column_stack([objects.feature[later], undetected[earlier].astype(np.float64)])
    return UndetectedNoise(
        first=_row(logistic(objects.feature[first], undetected[first], everywhere)),
        later=_row(logistic(with_memory, undetected[later], np.append(everywhere, 0.0))),
    )


def logistic(feature: Floats, outcome: Bools, prior: Floats) -> Floats:
    """Weights ``[n]`` of the features ``[R, n]`` in the log-odds of ``outcome``, with a normal prior around ``prior``.

    Newton's method; the problem is convex. Steps are halved until the penalised likelihood grows.
    """
    weight = np.array(prior, dtype=np.float64)
    value = _penalised(feature, outcome, weight, prior)
    for _ in range(_STEPS):
        chance = 1 / (1 + np.exp(-feature @ weight))
        slope = feature.T @ (outcome - chance) - _RIDGE * (weight - prior)
        curvature = (feature * (chance * (1 - chance))[:, None]).T @ feature + _RIDGE * np.eye(len(weight))
        step = np.linalg.solve(curvature, slope)
        new = _penalised(feature, outcome, weight + step, prior)
        while new < value and np.abs(step).max() > 1e-9:
            step = step / 2
            new = _penalised(feature, outcome, weight + step, prior)
        weight, value = weight + step, new
        if np.abs(step).max() < 1e-9:
            break
    return weight


def _penalised(feature: Floats, outcome: Bools, weight: Floats, prior: Floats) -> float:
    """Log-likelihood less the penalty."""
    sign = np.where(outcome, -1.0, 1.0)
    return float(-np.logaddexp(0.0, sign * (feature @ weight)).sum() - _RIDGE / 2 * ((weight - prior) ** 2).sum())


def _row(weight: Floats) -> tuple[float, ...]:
    return tuple(round(float(value), 4) for value in weight)
