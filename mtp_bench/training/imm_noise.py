"""The fit of the noise of the IMM predictor to windows of tracks, by the criterion of ``motion_noise``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..prediction.imm import Mixture, mixture
from ..prediction.imm_noise import MODELS, ImmNoise
from ..prediction.motion_noise import noise_of
from ..types import Bools, Floats

_MOST = 2500  # windows of a class that are fitted to
_START = [0.03, 5, 1, 0.2, 0.1, 1.5, 0.7, 3, 1.5, 0.3, 0.1, 1.5, 0.7, 1.5, 0.7, 0.1]
# Limits of the fit: measurement, speed (2), jerkiness (6), acceleration (6), odds of another model; a noise of 0 would
# make a filter deaf.
_LIMITS = [(0.005, 1), (0.1, 30), (0.05, 10), *[(0.02, 20)] * 12, (0.005, 1)]


def fit_imm_noise(position: Floats, valid: Bools, future: Floats, dt: float) -> dict[str, Any]:
    """Noise of one class from windows in the heading frame of their last box.

    ``position`` [n, P, 2] and ``valid`` [n, P]: the past as a predictor sees it; ``future`` [n, T, 2]: the truth. At
    most 2 500 windows are looked at, drawn at random.
    """
    from scipy.optimize import minimize

    rows = np.random.default_rng(0).permutation(len(position))[:_MOST]
    position, valid, future = position[rows], valid[rows], future[rows]

    def loss(x: Floats) -> float:
        return imm_score(position, valid, future, noise_of(ImmNoise, [_row(np.exp(x))]), dt)

    bounds = [tuple(np.log(limit)) for limit in _LIMITS]
    best = minimize(loss, np.log(_START), method="L-BFGS-B", bounds=bounds, options={"eps": 1e-3, "maxiter": 40})
    return {field: np.round(value, 4).tolist() for field, value in _row(np.exp(best.x)).items()}


def _row(x: Floats) -> dict[str, Any]:
    return {
        "measurement": x[0],
        "speed": x[1:3],
        "jerkiness": x[3:9].reshape(MODELS, 2),
        "acceleration": x[9:15].reshape(MODELS, 2),
        "stay": 1 / (1 + x[15]),
    }


def imm_score(position: Floats, valid: Bools, future: Floats, noise: ImmNoise, dt: float) -> float:
    """Mean continuous ranked probability score (m) of the forecast mixtures of windows of one class.

    ``position`` [n, P, 2] and ``valid`` [n, P]: pasts, heading frame; ``future`` [n, T, 2]: the truth, m; ``noise``: of
    that class; ``dt``: frame period, s. The score of a mixture of normals: Grimit et al. 2006.
    """
    state = mixture(position, valid, np.zeros(len(position), dtype=np.int64), noise, dt)
    mean, variance = _forecast(state, dt * np.arange(1, future.shape[1] + 1))
    weight = state.probability[:, :, None, None]
    score = (weight * _distance(future - mean, variance)).sum(axis=0)
    for i in range(MODELS):
        for j in range(i + 1):
            apart = _distance(mean[i] - mean[j], variance[i] + variance[j])
            score -= (0.5 if i == j else 1.0) * weight[i] * weight[j] * apart
    return float(np.mean(score))


def _forecast(state: Mixture, tau: Floats) -> tuple[Floats, Floats]:
    """Means and variances [M, n, T, 2] of the models after the times ``tau`` [T]."""
    powers = np.stack([np.ones_like(tau), tau, tau**2 / 2], axis=-1)  # [T, 3]
    products = (powers[:, :, None] * powers[:, None]).reshape(len(tau), 9)
    variance = state.covariance.reshape(*state.mean.shape[:-1], 9) @ products.T
    return (state.mean @ powers.T).swapaxes(-1, -2), variance.swapaxes(-1, -2)


def _distance(mean: Floats, variance: Floats) -> Floats:
    """Expected absolute value of a normal variable."""
    from scipy.special import ndtr

    deviation = np.sqrt(variance)
    z = mean / deviation
    expected: Floats = mean * (2 * ndtr(z) - 1) + 2 * deviation * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    return expected
