"""Misses of a simulated detector: recall, memory, first frames, occlusion, other frame periods, neutral objects."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mtp_bench.detector.sight import Sensor, sight
from mtp_bench.detector.simulate import simulate
from mtp_bench.detector.variants import with_variant
from mtp_bench.types import Bools
from tests.support.detector_scenes import CLASSES, DT, crowd, detect, inner_gaps, on_grid, seen_at, truth_of
from tests.support.model1_scenes import missing, noisy

FRAMES, OBJECTS = 200, 300


def _sigmoid(logit: float) -> float:
    return float(1 / (1 + np.exp(-logit)))


def _gone(base: float, lag: float, first: float | None = None, variant: str = "as_fitted", dt: float = DT) -> Bools:
    truth = crowd(FRAMES, OBJECTS)
    profile = with_variant(noisy(miss=missing(base, lag, first)), variant)  # type: ignore[arg-type]
    return ~on_grid(detect(truth, profile, seen_at(truth, 20.0), dt=dt), OBJECTS)[0]


def test_recall_and_odds_ratio_are_those_of_the_chain() -> None:
    undetected = _gone(-2.0, 2.5, first=-1.0)
    chance, expected = _sigmoid(-1.0), []
    for _ in range(FRAMES):
        expected.append(chance)
        chance = (1 - chance) * _sigmoid(-2.0) + chance * _sigmoid(0.5)
    assert undetected[0].mean() == pytest.approx(expected[0], abs=0.08)
    assert undetected.mean() == pytest.approx(np.mean(expected), abs=0.01)
    before, after = undetected[:-1], undetected[1:]
    odds = (before & after).sum() * (~before & ~after).sum() / ((before & ~after).sum() * (~before & after).sum())
    assert np.log(odds) == pytest.approx(2.5, abs=0.1)


def test_gaps_last_as_long_as_the_chain_stays_in_a_miss() -> None:
    gaps = inner_gaps(~_gone(-2.0, 2.5))
    assert gaps.mean() == pytest.approx(1 / (1 - _sigmoid(0.5)), rel=0.03)


def test_without_memory_the_recall_is_the_same_and_gaps_are_as_short_as_chance_makes_them() -> None:
    fitted, memoryless = _gone(-2.0, 2.5), _gone(-2.0, 2.5, variant="iid")
    share = memoryless.mean()
    assert share == pytest.approx(fitted.mean(), abs=0.01)
    assert inner_gaps(~memoryless).mean() == pytest.approx(1 / (1 - share), rel=0.03)
    assert inner_gaps(~memoryless).mean() < 0.6 * inner_gaps(~fitted).mean()
    assert len(inner_gaps(~memoryless)) > 1.5 * len(inner_gaps(~fitted))


@pytest.mark.parametrize("steps", [5.0, 2.0, 1.0, 0.5])
def test_at_another_frame_period_the_share_stays_and_the_correlation_decays(steps: float) -> None:
    undetected = _gone(-2.0, 3.5, dt=DT * steps).astype(float)
    after_hit, after_miss = _sigmoid(-2.0), _sigmoid(1.5)
    assert undetected.mean() == pytest.approx(after_hit / (1 - after_miss + after_hit), abs=0.015)
    correlation = np.corrcoef(undetected[:-1].ravel(), undetected[1:].ravel())[0, 1]
    assert correlation == pytest.approx((after_miss - after_hit) ** steps, abs=0.03)


def test_an_object_is_first_seen_at_its_first_frame_and_after_it_has_been_away() -> None:
    # object 0:  x x . x x x      object 1:  . . x x . x      always undetected at first, never later
    frame = np.array([0, 1, 2, 3, 3, 4, 5, 5])
    object_id = np.array([0, 0, 1, 0, 1, 0, 0, 1])
    box = np.tile([0.0, 5.0, 0.8, 0.0, 4.0, 2.0, 1.6], (8, 1))
    box[:, 0] = 20.0 * object_id
    truth = truth_of(frame, object_id, box, frames=6)
    detections = detect(truth, noisy(miss=missing(-30.0, 0.0, first=30.0)), seen_at(truth, 20.0))
    hit = on_grid(detections, 2)[0]
    assert np.argwhere(hit[:, 0]).ravel().tolist() == [1, 4, 5]
    assert np.argwhere(hit[:, 1]).ravel().tolist() == [3]


def test_an_object_that_comes_back_into_view_is_new() -> None:
    x = np.array([10.0, 10.0, 90.0, 10.0, 10.0])
    box = np.tile([0.0, 0.0, 0.8, 0.0, 4.0, 2.0, 1.6], (5, 1))
    box[:, 0] = x
    truth = truth_of(np.arange(5), np.zeros(5, int), box, frames=5)
    profile = noisy(miss=missing(-30.0, 0.0, first=30.0))
    detections = simulate(truth, np.zeros((5, 4)), CLASSES, profile, Sensor(50.0, np.pi), seed=0, dt=DT)
    assert np.diff(detections.start).tolist() == [0, 1, 0, 0, 1]


@pytest.mark.parametrize(
    ("name", "occlusion", "truncated", "distance", "logit"),
    [
        ("near", 0, False, 0.0, -2.0),
        ("30 m", 0, False, 30.0, -2.0 + 3 * 0.5),
        ("partly", 1, False, 0.0, -2.0 + 0.7),
        ("largely", 2, False, 0.0, -2.0 + 1.4),
        ("hidden", 3, False, 0.0, -2.0 + 4.0),
        ("truncated", 0, True, 0.0, -2.0 + 2.0),
        ("largely, truncated, 10 m", 2, True, 10.0, -2.0 + 1.4 + 2.0 + 0.5),
    ],
)
def test_log_odds_add_up(name: str, occlusion: int, truncated: bool, distance: float, logit: float) -> None:
    weights = (-2.0, 0.5, 0.7, 1.4, 4.0, 2.0)
    profile = noisy(miss={"first": weights, "later": (*weights, 0.0)})
    truth = crowd(40, 250)
    hit = on_grid(detect(truth, profile, seen_at(truth, distance, occlusion, truncated=truncated)), 250)[0]
    assert 1 - hit.mean() == pytest.approx(_sigmoid(logit), abs=0.02), name


def test_a_car_behind_a_truck_is_not_seen() -> None:
    box = np.array([[20.0, 0.0, 1.5, np.pi / 2, 12.0, 2.5, 3.5], [30.0, 0.0, 0.8, 0.0, 4.0, 2.0, 1.6]])
    truth = truth_of(np.zeros(2, int), np.arange(2), box, frames=1)
    hidden = (-30.0, 0.0, 0.0, 0.0, 60.0, 0.0)
    profile = noisy(miss={"first": hidden, "later": (*hidden, 0.0)})
    detections = simulate(truth, np.zeros((1, 4)), CLASSES, profile, Sensor(50.0, 2 * np.pi), seed=0, dt=DT)
    np.testing.assert_array_equal(detections.box, box[:1])


def test_neutral_objects_are_detected_like_others() -> None:
    truth = crowd(FRAMES, 50)
    neutral = dataclasses.replace(truth, neutral=np.ones_like(truth.neutral))
    profile = noisy(miss=missing(-1.0, 2.0))
    plain = detect(truth, profile, seen_at(truth, 20.0))
    np.testing.assert_array_equal(detect(neutral, profile, seen_at(neutral, 20.0)).box, plain.box)


def test_a_given_sight_is_the_one_that_would_be_computed() -> None:
    truth, ego = crowd(20, 10), np.tile([50.0, 0.0, 0.0, 0.0], (20, 1))
    sensor = Sensor(60.0, 2 * np.pi)
    profile = noisy(miss=missing(-1.0, 2.0))
    given = simulate(truth, ego, CLASSES, profile, sensor, 3, DT, sight(truth, ego, sensor))
    np.testing.assert_array_equal(given.box, simulate(truth, ego, CLASSES, profile, sensor, 3, DT).box)
