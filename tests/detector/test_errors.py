"""Errors of position, heading, size, height and velocity against the distribution and memory of a profile."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from mtp_bench.core import Floats
from mtp_bench.core.geometry import wrap_angle
from tests.support.detector_scenes import DT, NEW, cars, detect, on_grid, profile_of, seen_at

FRAMES, OBJECTS, GAP = 200, 300, 30.0
SURE = {"location": (9.0, 0, 0, 0, 0, 0, 0)}  # always detected
AXIS = {**NEW, "s0": 0.1, "s1": 0.0}


def errors(distance: float = 20.0, bearing: float = 0.0, dt: float = DT, **noise: Any) -> Floats:
    """Errors of the boxes of cars in a row ``[F, J, 7]``."""
    truth = cars(FRAMES, OBJECTS, GAP)
    visibility = seen_at(truth, distance, bearing=bearing)
    found = detect(truth, profile_of(quality=SURE, **noise), visibility=visibility, dt=dt)
    error = on_grid(found, GAP, OBJECTS)[2] - truth.box.reshape(FRAMES, OBJECTS, 7)
    error[..., 3] = wrap_angle(error[..., 3])
    return error


def test_position_errors_are_students_t_with_a_scale_that_grows_with_distance() -> None:
    error = errors(distance=30.0, radial={"s0": 0.02, "s1": 0.01}, nu=8.0)[..., 0] / (0.02 + 3 * 0.01)
    assert error.std() == pytest.approx(np.sqrt(8 / 6), rel=0.02)
    tails = [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999]
    np.testing.assert_allclose(np.quantile(error, tails), stats.t.ppf(tails, 8.0), rtol=0.08, atol=0.02)


@pytest.mark.parametrize(("bearing", "axis"), [(0.0, 0), (np.pi / 2, 1)])
def test_radial_errors_are_along_the_line_of_sight_and_tangential_ones_across(bearing: float, axis: int) -> None:
    radial, across = errors(bearing=bearing, radial=AXIS), errors(bearing=bearing, tangential=AXIS)
    assert radial[..., axis].std() > 0.1
    assert np.abs(radial[..., 1 - axis]).max() < 1e-9
    assert across[..., 1 - axis].std() > 0.1
    assert np.abs(across[..., axis]).max() < 1e-9


def test_position_errors_end_at_two_metres() -> None:
    error = errors(radial={**AXIS, "s0": 1.0}, nu=2.0)[..., 0]
    assert np.abs(error).max() == pytest.approx(2.0)
    assert (np.abs(error) > 1.999).mean() == pytest.approx(2 * stats.t.cdf(-2.0, 2.0), abs=0.01)


def test_headings_have_the_stated_robust_deviation_and_the_shape_of_t4() -> None:
    error = errors(heading={"scale": 0.05})[..., 3].ravel()
    assert 1.4826 * np.median(np.abs(error)) == pytest.approx(0.05, rel=0.02)
    tails = [0.01, 0.1, 0.9, 0.99]
    scale = 0.05 / (1.4826 * stats.t.ppf(0.75, 4))
    np.testing.assert_allclose(np.quantile(error, tails), scale * stats.t.ppf(tails, 4), rtol=0.05)


@pytest.mark.parametrize("steps", [1, 3])
def test_flips_are_a_chain(steps: int) -> None:
    flipped = np.abs(errors(dt=steps * DT, heading={"flip": 0.03, "flip_again": 0.4})[..., 3]) > np.pi / 2
    share = 0.03 / (1 - 0.4 + 0.03)
    assert (flipped[0].mean(), flipped.mean()) == (pytest.approx(share, abs=0.03), pytest.approx(share, abs=0.004))
    again = share + (1 - share) * 0.37**steps
    assert (flipped[1:] & flipped[:-1]).sum() / flipped[:-1].sum() == pytest.approx(again, abs=0.03)


def test_sizes_err_mostly_with_the_object_and_heights_in_every_frame() -> None:
    size: dict[str, Any] = {"mean": (0.1, -0.05, 0.02), "deviation": (0.3, 0.1, 0.05), "white": 0.1}
    error = errors(size=size, z=(0.1, 0.2))
    np.testing.assert_allclose(error[..., 4:].mean((0, 1)), size["mean"], atol=0.05)
    np.testing.assert_allclose(error[..., 4:].std((0, 1)), size["deviation"], rtol=0.1)
    assert np.corrcoef(error[:-1, :, 4].ravel(), error[1:, :, 4].ravel())[0, 1] == pytest.approx(0.9, abs=0.03)
    assert abs(np.corrcoef(error[0, :, 4], error[0, :, 5])[0, 1]) < 0.2  # each side errs on its own
    assert (error[..., 2].mean(), error[..., 2].std()) == (pytest.approx(0.1, abs=0.01), pytest.approx(0.2, rel=0.02))
    least = errors(size={"mean": (-9.0, -9.0, -9.0)})[0, 0, 4:] + np.array([4.0, 2.0, 1.6])
    np.testing.assert_allclose(least, [1.2, 0.6, 0.48])


def test_velocities_err_equally_along_and_across_or_are_not_measured() -> None:
    truth = cars(FRAMES, OBJECTS)
    truth.velocity[:] = 1.0, 2.0
    measured = detect(truth, profile_of(quality=SURE, velocity=0.3), visibility=seen_at(truth, 20.0, bearing=0.7))
    np.testing.assert_allclose(measured.velocity.mean(0), [1.0, 2.0], atol=0.01)
    np.testing.assert_allclose(np.cov(measured.velocity.T), 0.09 * np.eye(2), atol=0.003)
    assert np.isnan(detect(truth, profile_of(velocity=None)).velocity).all()
