"""Random numbers depend on seed, kind, object and frame alone, not on other objects, their order or the process."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.core import Detections
from mtp_bench.detector.draws import Draws, NoiseKind, decayed, keys_of
from tests.support.detector_scenes import LASTING, NEAR, cars, correlation, detect, on_grid, profile_of

LAPSES = {"share": 0.4, "bias": 0.3, "phi": 0.8, "shared": 0.8}
EVERYTHING = {
    "quality": {**LASTING, "shared": 0.7, "lapses": LAPSES},
    "radial": {**LASTING, "s0": 0.2, "s1": 0.1, "shared": 0.5, "quality": 0.3},
    "heading": {"scale": 0.1, "flip": 0.1, "flip_again": 0.5},
    "size": {"mean": (0.1, 0, 0), "deviation": (0.2, 0.1, 0.1)}, "velocity": 0.3, "near": NEAR,
}  # fmt: skip


FULL = profile_of(**EVERYTHING)


def same(one: Detections, other: Detections) -> bool:
    return all(np.array_equal(column, getattr(other, name)) for name, column in vars(one).items())


def test_permuted_objects_are_detected_alike() -> None:
    truth = cars(30, 12, 4.0)
    order = np.concatenate([12 * t + np.random.default_rng(t).permutation(12) for t in range(30)])
    columns = ("box", "velocity", "class_id", "object_id", "eligible", "neutral")
    turned = replace(truth, **{name: getattr(truth, name)[order] for name in columns})
    assert same(detect(truth, FULL), detect(turned, FULL))


def test_far_objects_and_other_frames_do_not_matter() -> None:
    """Objects beyond the reach of neighbours may go, to the last digit of all others."""
    truth = cars(30, 20, 9.0)
    whole = detect(truth, FULL)
    left = detect(truth.select(truth.box[:, 0] < 70.0), FULL)
    near = [found.select(found.box[:, 0] < 30.0) for found in (whole, left)]
    assert len(near[0].box) > 60
    assert same(near[0], near[1])
    # those nearer than 20 m do matter
    close = detect(truth.select(truth.box[:, 0] < 20.0), FULL)
    assert not same(close.select(close.box[:, 0] < 15.0), whole.select(whole.box[:, 0] < 15.0))


def test_numbers_are_uniform_and_independent() -> None:
    ids, frames = np.arange(400)[None, :], np.arange(300)[:, None]
    one = Draws(7).uniform(NoiseKind.QUALITY, 0, keys_of(ids, frames))
    assert abs(one.mean() - 0.5) < 0.004
    assert abs(one.var() - 1 / 12) < 0.002
    others = [
        Draws(8).uniform(NoiseKind.QUALITY, 0, keys_of(ids, frames)),
        Draws(7).uniform(NoiseKind.RADIAL, 0, keys_of(ids, frames)),
        Draws(7).uniform(NoiseKind.QUALITY, 1, keys_of(ids, frames)), one[:, np.roll(np.arange(400), 1)],
        one[np.roll(np.arange(300), 1)], Draws(7).uniform(NoiseKind.QUALITY, 0, keys_of(frames, ids)),
    ]  # fmt: skip
    for other in others:
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.012
    assert len(np.unique(one)) == one.size


def test_memory_decays_with_the_frame_period() -> None:
    """Frames twice as far apart have the correlation over two frames."""
    quality = {"bias": 0.0, "ar": 1.0, "phi": 0.8, "white": 0.0, "location": (4, 0, 0, 0, 0, 0, 0)}
    profile = profile_of(quality=quality)
    scores = [detect(cars(400, 40, 30.0), profile.model_copy(update={"dt": dt})) for dt in (0.5, 0.25)]
    (one, two), (twice, _) = (
        [correlation(score[:-lag].ravel(), score[lag:].ravel()) for lag in (1, 2)]
        for _, score, _ in (on_grid(found, 30.0, 40) for found in scores)
    )
    assert twice == pytest.approx(two, abs=0.04)
    assert one > two + 0.08


@pytest.mark.parametrize(("steps", "expected"), [(1.0, -0.5), (2.0, 0.25), (0.3 / 0.1, -0.125), (1.5, -(0.5**1.5))])
def test_a_negative_correlation_over_frames(steps: float, expected: float) -> None:
    assert float(decayed(np.asarray(-0.5), steps)) == pytest.approx(expected)
    assert float(decayed(np.asarray(-0.5), np.inf)) == 0.0
