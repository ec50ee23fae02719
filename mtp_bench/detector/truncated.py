"""Normal numbers that end at a lowest and a highest value: drawn from latent ones, and fitted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Bools, Floats

_BEYOND = 30.0  # deviations from location to limit: beyond, probabilities lose all digits
_STEADY = 3.0  # a fitted deviation is at most this many times that of the values
_TINY = 1e-300


class _Ends(NamedTuple):
    """Limits in deviations from the location, mirrored where the lower one is above it: tails keep their digits."""

    location: Floats
    low: Floats
    high: Floats
    mirrored: Bools


def within_limits(latent: Floats, location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Truncated normal numbers with the ranks of the standard normal ones ``latent``; all ``[R]``.

    ``location`` and ``deviation``: of the numbers before truncation; ``lowest`` and ``highest``: their limits.
    Without deviation: the location, brought within the limits.
    """
    from scipy.special import ndtr, ndtri

    ends = _ends(location, deviation, lowest, highest)
    below = ndtr(ends.low)
    rank = below + ndtr(_turned(latent, ends.mirrored)) * (ndtr(ends.high) - below)
    value = ends.location + _scale(deviation) * _turned(ndtri(rank), ends.mirrored)
    return np.asarray(np.clip(np.where(deviation > 0, value, location), lowest, highest))


def latent_of(value: Floats, location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> Floats:
    """The standard normal numbers of which `within_limits` makes ``value``; NaN stays.

    ``location``, ``deviation``, ``lowest`` and ``highest`` as there.
    """
    from scipy.special import ndtr, ndtri

    ends = _ends(location, deviation, lowest, highest)
    below = ndtr(ends.low)
    at = ndtr(_turned((value - ends.location) / _scale(deviation), ends.mirrored))
    rank = (at - below) / np.maximum(ndtr(ends.high) - below, _TINY)
    return _turned(np.asarray(ndtri(np.clip(rank, 1e-12, 1 - 1e-12))), ends.mirrored)


def fit_truncated(value: Floats, power: Floats, lowest: float, highest: float) -> tuple[Floats, float]:
    """Coefficients ``[n]`` of the location over ``power`` ``[R, n]``, and the deviation, by maximum likelihood.

    Values that crowd at a limit are those of a location far beyond it, which hangs together with the deviation: that
    one stays below thrice the values' own.
    """
    from scipy.optimize import minimize

    start = np.linalg.lstsq(power, value, rcond=None)[0]
    spread = float((value - power @ start).std())
    if spread < 1e-6:
        return start, 0.0
    # In coordinates along which the likelihood curves alike.
    triangle = np.linalg.qr(power, mode="r") / np.sqrt(len(value))
    basis = np.linalg.solve(triangle.T, power.T).T

    def loss(unknown: Floats) -> float:
        deviation = np.full(len(value), spread * np.exp(unknown[-1]))
        location = basis @ unknown[:-1] * spread
        return -float(_log_density(value, location, deviation, lowest, highest).mean())

    first = np.append(triangle @ start / spread, 0.0)
    bounds = [(None, None)] * len(start) + [(-3.0, float(np.log(_STEADY)))]
    best = minimize(loss, first, method="L-BFGS-B", bounds=bounds, options={"maxiter": 500}).x
    return np.linalg.solve(triangle, best[:-1] * spread), float(spread * np.exp(best[-1]))


def _log_density(value: Floats, location: Floats, deviation: Floats, lowest: float, highest: float) -> Floats:
    from scipy.special import log_ndtr

    ends = _ends(location, deviation, np.full(len(value), lowest), np.full(len(value), highest))
    # log(Phi(b) - Phi(a)) by logarithms, as both may be tiny.
    above = log_ndtr(ends.high)
    mass = above + np.log(np.maximum(-np.expm1(np.minimum(log_ndtr(ends.low) - above, 0.0)), _TINY))
    return np.asarray(-0.5 * ((value - ends.location) / deviation) ** 2 - np.log(deviation) - mass)


def _ends(location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> _Ends:
    scale = _scale(deviation)
    location = np.clip(location, lowest - _BEYOND * scale, highest + _BEYOND * scale)
    low, high = (lowest - location) / scale, (highest - location) / scale
    mirrored = np.asarray(low > 0)
    return _Ends(location, np.where(mirrored, -high, low), np.where(mirrored, -low, high), mirrored)


def _scale(deviation: Floats) -> Floats:
    return np.asarray(np.where(deviation > 0, deviation, 1.0))


def _turned(value: Floats, mirrored: Bools) -> Floats:
    return np.asarray(np.where(mirrored, -value, value))
