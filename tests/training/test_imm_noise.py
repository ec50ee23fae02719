"""The fit of the IMM's noise: its score, and that it betters the start."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.prediction.imm import mixture
from mtp_bench.prediction.imm_noise import ImmNoise
from mtp_bench.prediction.motion_noise import noise_of
from mtp_bench.training.imm_noise import _START, _row, fit_imm_noise, imm_score
from mtp_bench.types import Bools, Floats

DT = 0.2
ROW = {
    "measurement": 0.1,
    "speed": [3.0, 0.5],
    "jerkiness": [[0.1, 0.1], [1.0, 0.5], [1.0, 0.5]],
    "acceleration": [[0.1, 0.1], [1.0, 0.5], [2.0, 1.0]],
    "stay": 0.9,
}


def windows(n: int, seed: int) -> tuple[Floats, Bools, Floats]:
    """Pasts [n, 5, 2], masks and futures [n, 4, 2]: half of them steady, half of them with a steady acceleration."""
    rng = np.random.default_rng(seed)
    tau = DT * np.arange(-4, 5)[:, None]
    velocity = rng.normal(size=(n, 1, 2)) * [4, 0.5]
    acceleration = rng.normal(size=(n, 1, 2)) * (rng.random((n, 1, 1)) < 0.5) * [2, 1]
    path = velocity * tau + acceleration * tau**2 / 2
    seen = path[:, :5] + 0.05 * rng.normal(size=(n, 5, 2))
    return seen, rng.random((n, 5)) < 0.9, path[:, 5:]


def test_the_score_is_that_of_samples() -> None:
    position, valid, future = windows(3, 0)
    noise = noise_of(ImmNoise, [ROW])
    state = mixture(position, valid, np.zeros(3, dtype=np.int64), noise, DT)
    rng = np.random.default_rng(1)
    tau = DT * np.arange(1, 5)
    scores = []
    for n in range(3):
        model = rng.choice(3, p=state.probability[:, n], size=60_000)
        for axis in range(2):
            factor = np.linalg.cholesky(state.covariance[:, n, axis])
            x = state.mean[model, n, axis] + (factor[model] @ rng.normal(size=(60_000, 3, 1)))[..., 0]
            drawn = x @ np.stack([np.ones_like(tau), tau, tau**2 / 2])
            apart = np.abs(drawn[::2] - drawn[1::2]).mean(axis=0)
            scores.append(np.abs(drawn - future[n, :, axis]).mean(axis=0) - apart / 2)
    assert imm_score(position, valid, future, noise, DT) == pytest.approx(np.mean(scores), rel=0.02)


def test_a_fit_betters_the_start_on_other_windows() -> None:
    found = fit_imm_noise(*windows(150, 2), DT)
    fresh = windows(1000, 3)
    start = noise_of(ImmNoise, [_row(np.array(_START))])
    assert imm_score(*fresh, noise_of(ImmNoise, [found]), DT) < 0.95 * imm_score(*fresh, start, DT)
    assert found["measurement"] == pytest.approx(0.05, rel=0.3)
