"""Normal numbers between limits, the law of the scores of model 1."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.detector.model1.truncated import within_limits


@pytest.mark.parametrize(("lowest", "highest"), [(-1.0, 1.0), (3.0, 4.0), (9.0, np.inf), (-20.0, -12.0), (50.0, 60.0)])
def test_scores_rise_with_the_latent_numbers_between_their_limits(lowest: float, highest: float) -> None:
    latent = np.linspace(-3, 3, 13)
    every = np.ones(13)
    score = within_limits(latent, 0 * every, every, lowest * every, highest * every)
    assert (np.diff(score) > 0).all()
    assert (score.min() > lowest, score.max() < highest) == (True, True)


def test_without_deviation_scores_are_the_location_within_the_limits() -> None:
    none, location = np.zeros(3), np.array([0.1, 0.5, 2.0])
    score = within_limits(np.array([-1.0, 0.0, 1.0]), location, none, none + 0.3, none + 1.0)
    assert score.tolist() == [0.3, 0.5, 1.0]


def test_a_normal_distribution_far_from_its_limits_stays() -> None:
    latent, every = np.linspace(-3, 3, 13), np.ones(13)
    score = within_limits(latent, 2 * every, 0.5 * every, -50 * every, np.inf * every)
    np.testing.assert_allclose(score, 2.0 + 0.5 * latent, atol=1e-9)
