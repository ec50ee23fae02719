"""The parts of the fitter, on known numbers: undetected objects, memory, scores between limits, false positives."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from mtp_bench.detector.fit.detector import fit_false_positives, logistic
from mtp_bench.detector.fit.errors import fit_memory
from mtp_bench.detector.fit.samples import FalsePositiveSamples, ObjectSamples
from mtp_bench.detector.profile import ScoreNoise
from mtp_bench.detector.truncated import fit_truncated, latent_of, within_limits


@pytest.mark.parametrize("location", [4.0, 2.0, 0.5])
def test_the_normal_distribution_behind_scores_above_a_floor(location: float) -> None:
    rng = np.random.default_rng(0)
    power = np.column_stack([np.ones(20000), rng.uniform(0, 6, 20000)])
    coefficients = np.array([location, -0.2])
    every = np.ones(20000)
    score = within_limits(rng.normal(size=20000), power @ coefficients, every, 2.0 * every, 6.0 * every)
    assert score.min() > 2.0
    found, deviation = fit_truncated(score, power, 2.0, 6.0)
    assert found == pytest.approx(coefficients, abs=0.15)
    assert deviation == pytest.approx(1.0, rel=0.06)


@pytest.mark.parametrize(("lowest", "highest"), [(-1.0, 1.0), (3.0, 4.0), (9.0, np.inf), (-20.0, -12.0), (50.0, 60.0)])
def test_latent_numbers_come_back_from_scores(lowest: float, highest: float) -> None:
    latent = np.linspace(-3, 3, 13)
    every = np.ones(13)
    score = within_limits(latent, 0 * every, every, lowest * every, highest * every)
    assert (np.diff(score) > 0).all()
    assert (score.min() > lowest, score.max() < highest) == (True, True)
    if abs(lowest) < 30:
        np.testing.assert_allclose(
            latent_of(score, 0 * every, every, lowest * every, highest * every), latent, atol=1e-3
        )


def test_duplicates_count_neither_in_the_rate_nor_in_its_dispersion() -> None:
    false = FalsePositiveSamples(
        count=np.array([3, 1, 0, 2]),
        own=np.array([1, 1, 0, 2]),
        duplicate=np.array([True, False, True, False, False, False]),
        judged=np.ones(6, dtype=bool),
        followed=np.zeros(6, dtype=bool),
        score=np.array([9.0, 1.1, 9.0, 1.2, 1.3, 1.4]),
        size=np.ones((6, 3)),
        distance=np.array([99.0, 1.0, 99.0, 20.0, 30.0, 40.0]),
        scene=np.zeros(6, dtype=int),
        frame=np.array([0, 0, 0, 1, 3, 3]),
        place=np.zeros((6, 2)),
        beside=np.full(6, np.inf),
        of_class=np.zeros(6, dtype=bool),
        parent=np.full(6, np.nan),
    )
    limits = ScoreNoise(bias=0, ar=0, phi=0, white=1, quadratic=(2, 0, 0), deviation=1, floor=1.0)
    every = {one.name: np.tile(getattr(false, one.name), (10, 1) if one.name in ("size", "place") else 10)
             for one in fields(false)}  # fmt: skip
    law = fit_false_positives(FalsePositiveSamples(**every), limits)
    assert law is not None
    assert (law.rate, law.dispersion) == (1.0, 1.0)
    assert (law.distance[0], law.distance[-1]) == (2.0, 40.0)


def test_without_deviation_scores_are_the_location_within_the_limits() -> None:
    none, location = np.zeros(3), np.array([0.1, 0.5, 2.0])
    score = within_limits(np.array([-1.0, 0.0, 1.0]), location, none, none + 0.3, none + 1.0)
    assert score.tolist() == [0.3, 0.5, 1.0]
    assert fit_truncated(np.ones(20), np.ones((20, 1)), 0.0, np.inf)[1] == 0.0


def test_scores_that_crowd_at_the_floor_have_their_mean() -> None:
    """Exponential ones: the likelihood has no maximum, so the deviation ends at a bound."""
    rng = np.random.default_rng(0)
    score = 0.3 + rng.exponential(0.1, 4000)
    (location,), deviation = fit_truncated(score, np.ones((4000, 1)), 0.3, np.inf)
    assert np.isfinite(location)
    assert location < 0.3
    every = np.ones(20000)
    again = within_limits(rng.normal(size=20000), location * every, deviation * every, 0.3 * every, np.inf * every)
    assert again.mean() == pytest.approx(score.mean(), rel=0.02)


def test_logistic_regression() -> None:
    rng = np.random.default_rng(0)
    feature = np.column_stack([np.ones(20000), rng.normal(size=(20000, 2)), np.zeros(20000)])
    outcome = rng.random(20000) < 1 / (1 + np.exp(-feature @ [-1.0, 2.0, 0.0, 0.0]))
    weight = logistic(feature, outcome, np.array([0.0, 0.0, 0.0, 0.7]))
    assert weight == pytest.approx([-1.0, 2.0, 0.0, 0.7], abs=0.07)
    assert weight[3] == pytest.approx(0.7)  # a feature that never occurs stays where it was
    everywhere = logistic(np.ones((50, 1)), np.ones(50, dtype=bool), np.zeros(1))
    assert 2 < everywhere[0] < 6  # finite though nothing was hit


def test_memory_of_white_numbers_is_none_and_of_constant_ones_all() -> None:
    rng = np.random.default_rng(0)
    frames, objects = 40, 300
    white = rng.normal(size=(objects, frames))
    constant = np.repeat(white[:, :1], frames, axis=1)
    samples = _all_hit(objects, frames)
    assert fit_memory(samples, white.ravel()).white == pytest.approx(1.0, abs=0.03)
    kept = fit_memory(samples, constant.ravel())
    assert kept.bias + kept.ar * kept.phi == pytest.approx(1.0, abs=0.03)
    short = fit_memory(_all_hit(3, 4), white[:3, :4].ravel())
    assert (short.bias, short.ar, short.white) == (0.0, 0.0, 1.0)  # too few pairs to say


def _all_hit(objects: int, frames: int) -> ObjectSamples:
    rows = objects * frames
    return ObjectSamples(
        object=np.repeat(np.arange(objects), frames),
        frame=np.tile(np.arange(frames), objects),
        hit=np.ones(rows, dtype=bool),
        feature=np.zeros((rows, 6)),
        error=np.zeros((rows, 7)),
        velocity_error=np.zeros((rows, 2)),
        score=np.zeros(rows),
        scene=np.zeros(rows, dtype=int),
        place=np.zeros((rows, 2)),
        toward=np.zeros(rows),
    )
