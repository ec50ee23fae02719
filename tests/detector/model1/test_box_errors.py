"""Errors of position, heading, size, height, score and velocity against the margins and memory of a profile."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from mtp_bench.geometry import wrap_angle
from mtp_bench.types import Floats
from tests.support.detector_scenes import DT, MEMORY, WHITE, crowd, detect, on_grid, seen_at
from tests.support.model1_scenes import FALSE_POSITIVES, noisy

FRAMES, OBJECTS = 200, 300


def _errors(distance: float = 20.0, bearing: float = 0.0, dt: float = DT, **noise: Any) -> Floats:
    """Errors of the boxes of a crowd ``[F, J, 7]``."""
    truth = crowd(FRAMES, OBJECTS)
    box = on_grid(detect(truth, noisy(**noise), seen_at(truth, distance, bearing=bearing), dt=dt), OBJECTS)[1]
    error = box - truth.box.reshape(FRAMES, OBJECTS, 7)
    error[..., 3] = wrap_angle(error[..., 3])
    return error


def _lag(value: Floats, frames: int = 1) -> float:
    """Correlation of values ``[F, J]`` with those some frames later."""
    return float(np.corrcoef(value[:-frames].ravel(), value[frames:].ravel())[0, 1])


def test_position_errors_are_students_t_with_a_scale_that_grows_with_distance() -> None:
    error = _errors(distance=30.0, radial={"s0": 0.02, "s1": 0.01, "nu": 8.0, **WHITE})[..., 0] / (0.02 + 3 * 0.01)
    assert error.std() == pytest.approx(np.sqrt(8 / 6), rel=0.02)
    assert stats.kurtosis(error.ravel()) == pytest.approx(6 / 4, abs=0.4)
    tails = [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999]
    np.testing.assert_allclose(np.quantile(error, tails), stats.t.ppf(tails, 8.0), rtol=0.08, atol=0.02)


@pytest.mark.parametrize(("bearing", "axis"), [(0.0, 0), (np.pi / 2, 1), (-np.pi, 0)])
def test_radial_errors_are_along_the_line_of_sight_and_tangential_ones_across(bearing: float, axis: int) -> None:
    radial = _errors(bearing=bearing, radial={"s0": 0.1, "s1": 0.0, "nu": 8.0, **WHITE})
    across = _errors(bearing=bearing, tangential={"s0": 0.1, "s1": 0.0, "nu": 8.0, **WHITE})
    assert radial[..., axis].std() > 0.1
    assert np.abs(radial[..., 1 - axis]).max() < 1e-9
    assert across[..., 1 - axis].std() > 0.1
    assert np.abs(across[..., axis]).max() < 1e-9


@pytest.mark.parametrize("axis", ["radial", "tangential"])
@pytest.mark.parametrize("steps", [1, 5])
def test_position_errors_remember(axis: str, steps: int) -> None:
    noise: dict[str, Any] = {axis: {"s0": 0.05, "s1": 0.0, "nu": 4.0, **MEMORY}}
    error = _errors(dt=steps * DT, **noise)
    latent = stats.norm.ppf(stats.t.cdf(error[..., 0 if axis == "radial" else 1] / 0.05, 4.0))
    assert latent.std() == pytest.approx(1.0, abs=0.05)
    assert latent[0].std() == pytest.approx(1.0, abs=0.12)  # from the first frame on
    for lag in (1, 3):
        assert _lag(latent, lag) == pytest.approx(0.2 + 0.5 * 0.8 ** (lag * steps), abs=0.05)
    assert latent.mean(0).var() == pytest.approx(0.2, abs=0.08)  # the bias stays with the object


def test_kinds_of_errors_have_nothing_to_do_with_each_other() -> None:
    axis, score = {"s0": 0.05, "s1": 0.0, "nu": 8.0, **WHITE}, {"deviation": 1.0, "floor": -9.0, "ceiling": None}
    noise: dict[str, Any] = {"radial": axis, "tangential": axis, "heading": {"scale": 0.05}, "z": (0.0, 0.1)}
    noise |= {"size": {"deviation": (0.3, 0.2, 0.1), "white": 1.0}, "velocity": 0.2, "score": score}
    truth = crowd(FRAMES, OBJECTS)
    _, box, velocity, scores = on_grid(detect(truth, noisy(**noise), seen_at(truth, 20.0)), OBJECTS)
    values = np.concatenate([box.reshape(-1, 7), velocity.reshape(-1, 2), scores.reshape(-1, 1)], axis=1)
    values[:, 0] -= truth.box[:, 0]
    assert np.abs(np.corrcoef(values.T) - np.eye(10)).max() < 0.02


def test_position_errors_end_at_two_metres() -> None:
    error = _errors(radial={"s0": 1.0, "s1": 0.0, "nu": 2.0, **WHITE})[..., 0]
    assert np.abs(error).max() == pytest.approx(2.0)
    assert (np.abs(error) > 1.999).mean() == pytest.approx(2 * stats.t.cdf(-2.0, 2.0), abs=0.01)


def test_headings_have_the_stated_robust_deviation_and_the_shape_of_t4() -> None:
    error = _errors(heading={"scale": 0.05})[..., 3].ravel()
    assert 1.4826 * np.median(np.abs(error)) == pytest.approx(0.05, rel=0.02)
    tails = [0.01, 0.1, 0.9, 0.99]
    scale = 0.05 / (1.4826 * stats.t.ppf(0.75, 4))
    np.testing.assert_allclose(np.quantile(error, tails), scale * stats.t.ppf(tails, 4), rtol=0.05)


@pytest.mark.parametrize("steps", [1, 3])
def test_flips_are_a_chain(steps: int) -> None:
    flipped = np.abs(_errors(dt=steps * DT, heading={"flip": 0.03, "flip_again": 0.4})[..., 3]) > np.pi / 2
    share = 0.03 / (1 - 0.4 + 0.03)
    assert flipped[0].mean() == pytest.approx(share, abs=0.03)
    assert flipped.mean() == pytest.approx(share, abs=0.004)
    again = share + (1 - share) * 0.37**steps
    assert (flipped[1:] & flipped[:-1]).sum() / flipped[:-1].sum() == pytest.approx(again, abs=0.03)


def test_sizes_err_mostly_with_the_object() -> None:
    size: dict[str, Any] = {"mean": (0.1, -0.05, 0.02), "deviation": (0.3, 0.1, 0.05), "white": 0.1}
    error = _errors(size=size)[..., 4:]
    np.testing.assert_allclose(error.mean((0, 1)), size["mean"], atol=0.05)
    np.testing.assert_allclose(error.std((0, 1)), size["deviation"], rtol=0.1)
    assert _lag(error[..., 0]) == pytest.approx(0.9, abs=0.03)
    assert abs(np.corrcoef(error[0, :, 0], error[0, :, 1])[0, 1]) < 0.2  # each side errs on its own


def test_no_side_is_estimated_below_a_share_of_itself() -> None:
    estimated = _errors(size={"mean": (-9.0, -9.0, -9.0)})[0, 0, 4:] + np.array([4.0, 2.0, 1.6])
    np.testing.assert_allclose(estimated, [1.2, 0.6, 0.48])


def test_heights_have_the_stated_margin() -> None:
    error = _errors(z=(0.1, 0.2))[..., 2]
    assert error.mean() == pytest.approx(0.1, abs=0.01)
    assert error.std() == pytest.approx(0.2, rel=0.02)


def test_scores_fall_with_distance_and_remember() -> None:
    truth = crowd(FRAMES, OBJECTS)
    profile = noisy(score={"quadratic": (9.0, -0.5, -0.2), "deviation": 0.5, "floor": -9.0, "ceiling": None, **MEMORY})
    score = on_grid(detect(truth, profile, seen_at(truth, 30.0)), OBJECTS)[3]
    assert score.mean() == pytest.approx(9.0 - 1.5 - 1.8, abs=0.05)
    assert score.std() == pytest.approx(0.5, rel=0.05)
    assert _lag(score) == pytest.approx(0.2 + 0.5 * 0.8, abs=0.04)


def test_scores_stay_between_floor_and_ceiling() -> None:
    truth = crowd(FRAMES, 50)
    profile = noisy(score={"quadratic": (0.6, 0.0, 0.0), "deviation": 0.5, "floor": 0.3, "ceiling": 1.0})
    score = detect(truth, profile, seen_at(truth, 30.0)).score
    law = stats.truncnorm(-0.6, 0.8, loc=0.6, scale=0.5)
    assert stats.kstest(score, law.cdf).statistic < 0.015
    assert len(np.unique(score)) == len(score)  # none is brought to a limit


def test_velocities_err_by_the_same_along_and_across() -> None:
    truth = crowd(FRAMES, OBJECTS)
    measured = on_grid(detect(truth, noisy(velocity=0.3), seen_at(truth, 20.0, bearing=0.7)), OBJECTS)[2]
    np.testing.assert_allclose(measured.mean((0, 1)), [1.0, 2.0], atol=0.01)
    np.testing.assert_allclose(np.cov(measured.reshape(-1, 2).T), 0.09 * np.eye(2), atol=0.003)


def test_without_velocity_noise_there_are_no_velocities() -> None:
    truth = crowd(3, 4)
    profile = noisy(velocity=None, duplicates=0.5, false_positives={**FALSE_POSITIVES, "rate": 3.0})
    assert np.isnan(detect(truth, profile, seen_at(truth, 20.0)).velocity).all()


def test_duplicates_lie_beside_their_original_and_score_less() -> None:
    truth = crowd(FRAMES, OBJECTS)
    score = {"quadratic": (5.0, 0.0, 0.0), "deviation": 0.1, "floor": 0.0, "ceiling": None, "bias": 1.0, "white": 0.0}
    profile = noisy(score=score, duplicates=0.05)
    detections = detect(truth, profile, seen_at(truth, 20.0))
    assert len(detections.box) / len(truth.box) - 1 == pytest.approx(0.05, abs=0.004)
    second = np.abs(detections.box[:, 0] / 20 - np.rint(detections.box[:, 0] / 20)) > 1e-9
    assert second.mean() == pytest.approx(0.05 / 1.05, abs=0.004)
    beside = detections.box[second, 0] - 20 * np.rint(detections.box[second, 0] / 20)
    assert beside.std() == pytest.approx(0.2, rel=0.1)
    original = on_grid(detect(truth, noisy(score=score), seen_at(truth, 20.0)), OBJECTS)[3][0]  # constant over time
    column = np.rint(detections.box[second, 0] / 20).astype(int)
    less = original[column] - detections.score[second]
    assert less.min() >= 0.0
    assert less.mean() == pytest.approx(0.5 * 0.1 * np.sqrt(2 / np.pi), rel=0.1)
