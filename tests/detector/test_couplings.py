"""Couplings of a simulated detector that the fit does not find: recall with memory, floor, false positives."""

import numpy as np
import pytest

from mtp_bench.core import Bools, Floats
from mtp_bench.detector import Profile
from mtp_bench.detector.draws import skewed_cdf
from tests.support.detector_scenes import FREE, LASTING, NEAR, cars, detect, on_grid, profile_of

FRAMES, OBJECTS, GAP = 200, 60, 30.0
ERROR = {"s0": 0.3, "s1": 0.0}


def seen(profile: Profile, gap: float = GAP, seed: int = 0) -> tuple[Bools, Floats, Floats]:
    """Hits, scores and errors along x ``[F, J]`` of cars in a row."""
    hit, score, box = on_grid(detect(cars(FRAMES, OBJECTS, gap), profile, seed), gap, OBJECTS)
    return hit, score, box[..., 0] - gap * np.arange(OBJECTS)


@pytest.mark.parametrize("lapses", [0.0, 0.3, 0.7])
def test_recall_is_what_the_location_says(lapses: float) -> None:
    """Whatever lasts or is shared: the variance stays 1."""
    law = {"share": lapses, "bias": 0.0, "phi": 0.5, "shared": 0.7}
    quality = {"bias": 0.0, "ar": 0.6, "phi": 0.5, "white": 0.4, "shared": 0.7, "lapses": law}
    hit, _, _ = seen(profile_of(quality=quality), gap=4.0)
    assert hit.mean() == pytest.approx(float(skewed_cdf(np.asarray(1.2816), lapses)), abs=0.02)


def test_the_floor_drops_lower_scores_alone() -> None:
    truth = cars(60, 30, 5.0)
    parts = {"quality": LASTING, "radial": {**ERROR, **LASTING}, "free": FREE, "near": NEAR}
    raw = detect(truth, profile_of(**parts))
    high = detect(truth, profile_of(**{**parts, "quality": {**LASTING, "floor": 0.5}}))
    kept = raw.select(raw.score >= 0.5)
    assert 0 < len(high.box) < len(raw.box)
    for name in ("start", "box", "velocity", "score"):
        assert np.array_equal(getattr(high, name), getattr(kept, name))


def test_false_positives_beside_an_object_follow_it() -> None:
    truth = cars(100, 1)
    truth.box[:, 0] += 3.0 * np.arange(100)
    fixed = {**NEAR, "offset": (2.0,) * 11, "bias": 0.9, "ar": 0.05, "white": 0.05, "chance": 0.9}
    found = detect(truth, profile_of(near=fixed, quality={"location": (-9, 0, 0, 0, 0, 0, 0)}))
    off = np.hypot(*(found.box[:, :2] - truth.box[found.frame_of_rows, :2]).T)
    assert len(off) > 100
    np.testing.assert_allclose(off, 2.0, atol=1e-9)
    assert len(np.unique(np.round(found.box[:, 0] - truth.box[found.frame_of_rows, 0], 6))) == 2  # two slots, for ever


def test_a_duplicate_needs_its_original() -> None:
    truth = cars(200, 20)
    beside = {**NEAR, "offset": (0.5,) * 11}
    assert len(detect(truth, profile_of(near=beside, quality={"location": (-9, 0, 0, 0, 0, 0, 0)})).box) == 0
    assert len(detect(truth, profile_of(near=beside)).box) > 200 * 20
