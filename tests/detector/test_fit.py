"""The fit finds the parameters that made the detections, as far as a few scenes tell."""

import numpy as np
import pytest

from benchmarks.detection.couplings import couplings
from mtp_bench.core import Scene, Truth
from mtp_bench.detector import Profile
from mtp_bench.detector.draws import exponential, skewed, skewed_cdf, skewed_density
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import Sensor
from mtp_bench.training.detector_fit.profile import fit_profile
from mtp_bench.training.detector_fit.samples import Samples, collect_samples
from tests.support.detector_scenes import CLASSES, DT, FREE, NEAR, grid_truth, profile_of

SENSOR = Sensor(60.0, 2 * np.pi)
FRAMES, SCENES, OBJECTS = 25, 6, 40  # the tolerances below hold with other seeds of the detections, too
MEMORY = {"bias": 0.35, "ar": 0.5, "phi": 0.75, "white": 0.15}
LAPSES = {"share": 0.5, "bias": 0.5, "phi": 0.8, "shared": 0.7}


def original() -> Profile:
    axis = {**MEMORY, "s0": 0.05, "s1": 0.04, "quality": 0.3, "shared": 0.3}
    return profile_of(
        quality={**MEMORY, "shared": 0.2, "location": (2.6, -0.4, 0, 0, 0, 0, 0), "lapses": LAPSES}, radial=axis,
        tangential=axis, nu=4.0, velocity=0.3, heading={"scale": 0.05, "flip": 0.02, "flip_again": 0.4},
        free={**FREE, "rate": 6.0, "chance": 0.15, "siblings": 0.7, "family": 0.6}, near=NEAR,
    )  # fmt: skip


def a_truth(rng: np.random.Generator) -> Truth:
    """Standing cars in pairs 4 m apart around the sensor."""
    first = rng.uniform(-45, 45, (OBJECTS // 2, 2))
    first += 8.0 * np.sign(first)
    box = np.zeros((OBJECTS, 7))
    box[:, :2] = np.concatenate([first, first + np.array([0.0, 4.0])])
    box[:, 4:] = 4.0, 1.8, 1.5
    return grid_truth(np.tile(box, (FRAMES, 1, 1)), np.zeros((OBJECTS, 2)), np.zeros(OBJECTS, int))


def scenes_of(profile: Profile, seed: int) -> list[Scene]:
    rng = np.random.default_rng(1)
    scenes = []
    for i in range(SCENES):
        truth, ego = a_truth(rng), np.zeros((FRAMES, 4))
        found = simulate(truth, ego, CLASSES, profile, SENSOR, 100 * seed + i, DT)
        scenes.append(Scene(f"synthetic {i}", DT * np.arange(FRAMES), ego, truth, found))
    return scenes


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return scenes_of(original(), 1)


@pytest.fixture(scope="module")
def refit(scenes: list[Scene]) -> Profile:
    return fit_profile(scenes, CLASSES, DT, SENSOR, "refit", "", "")


def of_car(scenes: list[Scene]) -> Samples:
    return collect_samples(scenes, CLASSES, SENSOR)["car"]


def test_margins_come_back(refit: Profile) -> None:
    before, after = original().classes["car"], refit.classes["car"]
    assert after.quality.floor == pytest.approx(0.1, abs=0.002)
    for distance in (1.0, 4.0):
        mean = [np.dot(one.quality.location[:3], (1, distance, distance**2)) for one in (before, after)]
        chance = [float(skewed_cdf(-m, one.quality.lapses.share)) for m, one in zip(mean, (before, after), strict=True)]
        assert chance[1] == pytest.approx(chance[0], abs=0.06)
    assert 1 / after.nu == pytest.approx(1 / before.nu, abs=0.08)
    for axis in ("radial", "tangential"):
        one, two = getattr(before, axis), getattr(after, axis)
        assert two.s0 + 3 * two.s1 == pytest.approx(one.s0 + 3 * one.s1, rel=0.2)
        assert two.quality == pytest.approx(one.quality, abs=0.1)
        for lag in (1, 4):
            assert two.bias + two.ar * two.phi**lag == pytest.approx(one.bias + one.ar * one.phi**lag, abs=0.15)
        assert two.shared == pytest.approx(one.shared, abs=0.15)
    assert after.velocity == pytest.approx(0.3, rel=0.1)


def test_couplings_come_back(scenes: list[Scene], refit: Profile) -> None:
    """The refit, on the same truth with other random numbers, behaves as the original."""
    before = couplings(*of_car(scenes))
    runs = [couplings(*of_car(scenes_of(refit, seed))) for seed in (2, 3, 4)]

    def after(name: str) -> float:
        return float(np.mean([getattr(run, name) for run in runs]))

    for name, off in (
        ("score_and_error", 0.07),
        ("miss_ahead", 0.07),  # 0.055 on one machine, where the same fit ends elsewhere
        ("misses_together", 0.1),
        ("errors_together", 0.1),
    ):
        assert after(name) == pytest.approx(getattr(before, name), abs=off), name
    assert after("change") == pytest.approx(before.change, rel=0.2)
    assert after("false_together") == pytest.approx(before.false_together, rel=0.3)
    assert after("false_long") == pytest.approx(before.false_long, rel=0.3)
    assert after("false_per_frame") == pytest.approx(before.false_per_frame, rel=0.25)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_skewed_numbers(share: float) -> None:
    """Drawn, distributed and dense alike; mean 0, variance 1."""
    normal, tail = np.random.default_rng(0).standard_normal((2, 200_000))
    numbers = skewed(normal, exponential(tail), share)
    assert (numbers.mean(), numbers.var()) == pytest.approx((0.0, 1.0), abs=0.02)
    for value in (-1.5, -0.5, 0.0, 1.0, 3.0):
        assert float(skewed_cdf(np.asarray(value), share)) == pytest.approx((numbers < value).mean(), abs=0.004)
        slope = (skewed_cdf(np.asarray(value + 1e-4), share) - skewed_cdf(np.asarray(value - 1e-4), share)) / 2e-4
        assert float(skewed_density(np.asarray(value), share)) == pytest.approx(float(slope), rel=1e-3)
