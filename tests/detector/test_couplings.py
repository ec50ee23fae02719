"""Couplings of a simulated detector: quality, score, error, misses, neighbours, false positives."""

import numpy as np
import pytest
from scipy.stats import rankdata

from mtp_bench.core import Bools, Detections, Floats
from mtp_bench.detector import Profile
from mtp_bench.detector.draws import skewed_cdf
from tests.support.detector_scenes import AHEAD, FREE, LASTING, NEAR, cars, correlation, detect, on_grid, profile_of

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


@pytest.mark.parametrize(("gain", "low", "high"), [(0.5, -0.5, -0.2), (0.0, -0.04, 0.04)])
def test_a_low_score_tells_of_a_large_error(gain: float, low: float, high: float) -> None:
    _, score, error = seen(profile_of(radial={**ERROR, "quality": gain}))
    known = np.isfinite(score)
    assert low < np.corrcoef(rankdata(score[known]), rankdata(np.abs(error[known])))[0, 1] < high


@pytest.mark.parametrize(("memory", "low", "high"), [(LASTING, 0.1, 0.6), ({}, -0.03, 0.03)])
def test_a_low_score_tells_of_a_miss_in_the_next_frame(memory: dict[str, float], low: float, high: float) -> None:
    hit, score, _ = seen(profile_of(quality=memory))
    known = np.isfinite(score[:-1])
    now, missed = score[:-1][known], ~hit[1:][known]
    weak = now < np.quantile(now, 0.25)
    assert low < missed[weak].mean() - missed[~weak].mean() < high


@pytest.mark.parametrize(("gap", "lowest", "highest"), [(3.0, 0.3, 1.0), (25.0, -0.06, 0.06)])
def test_close_neighbours_share_scores_misses_and_errors(gap: float, lowest: float, highest: float) -> None:
    memory = {"bias": 0.0, "ar": 0.9, "phi": 0.5, "white": 0.1, "shared": 0.8}
    lapse = {"share": 0.5, "bias": 0.0, "phi": 0.5, "shared": 0.8}
    profile = profile_of(quality={**memory, "lapses": lapse}, radial={**memory, "s0": 0.1, "s1": 0.0})
    hit, score, error = seen(profile, gap)
    for value in ((~hit).astype(float), score, error):
        assert lowest < correlation(value[:, ::2].ravel(), value[:, 1::2].ravel()) < highest


def test_errors_have_tails_that_last() -> None:
    """Objects with large errors now have large ones later; the changes between frames are small for most."""
    radial = {**LASTING, "bias": 0.8, "ar": 0.0, "s0": 0.1}
    _, _, error = seen(profile_of(radial=radial, nu=2.5, quality={"location": (5, 0, 0, 0, 0, 0, 0)}))
    size = np.log(np.abs(error) + 1e-3)
    assert np.corrcoef(size[::40].ravel(), size[20::40].ravel())[0, 1] > 0.3
    change = np.abs(np.diff(error, axis=0))
    assert np.quantile(change, 0.95) / np.median(change) > 3.5  # 2.9 of normal numbers


def test_the_floor_drops_lower_scores_alone() -> None:
    truth = cars(60, 30, 5.0)
    parts = {"quality": LASTING, "radial": {**ERROR, **LASTING}, "free": FREE, "near": NEAR}
    raw = detect(truth, profile_of(**parts))
    high = detect(truth, profile_of(**{**parts, "quality": {**LASTING, "floor": 0.5}}))
    kept = raw.select(raw.score >= 0.5)
    assert 0 < len(high.box) < len(raw.box)
    for name in ("start", "box", "velocity", "score"):
        assert np.array_equal(getattr(high, name), getattr(kept, name))


def test_false_positives_stand_in_families_and_live() -> None:
    truth = cars(2000, 0)
    few = detect(truth, profile_of(free=FREE), sensor=AHEAD)
    many = detect(truth, profile_of(free={**FREE, "siblings": 1.0, "family": 0.8}), sensor=AHEAD)
    assert together(few) < 0.12
    assert together(many) > 0.4
    assert len(many.box) == pytest.approx(len(few.box), rel=0.25)
    assert followed(few) > 3 * followed(detect(truth, profile_of(free={**FREE, "survive": 0.0}), sensor=AHEAD))


def near_share(found: Detections, ahead: int, gate_m: float, others: int) -> float:
    """Share with more than ``others`` within ``gate_m`` in the frame that is ``ahead``."""
    count = 0
    for t in range(found.frames - ahead):
        place, later = found.box[found.rows(t), :2], found.box[found.rows(t + ahead), :2]
        off = np.hypot(*(place[:, None] - later[None]).transpose(2, 0, 1))
        count += int(((off < gate_m).sum(axis=1) > others).sum())
    return count / len(found.box)


def together(found: Detections) -> float:
    return near_share(found, 0, 3.0, 1)


def followed(found: Detections) -> float:
    return near_share(found, 1, 1.0, 0)


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
