"""False positives of a simulated detector: rate, dispersion, survival, places, looks, and who emits them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from mtp_bench.detector.sight import Sensor
from mtp_bench.detector.simulate import simulate
from mtp_bench.geometry import wrap_angle
from mtp_bench.types import Detections, Floats
from tests.support.detector_scenes import AHEAD, DT, MEMORY, nothing, truth_of
from tests.support.model1_scenes import FALSE_POSITIVES, in_empty_scene, noisy, perfect_with, profile1


def _survivors(detections: Detections) -> Floats:
    """Whether each box that has a next frame is there in it too, at the same place."""
    frame = detections.frame_of_rows
    places = {(int(t), float(x)) for t, x in zip(frame, detections.box[:, 0], strict=True)}
    last = len(detections.start) - 2
    kept = [(t + 1, float(x)) in places for t, x in zip(frame, detections.box[:, 0], strict=True) if t < last]
    return np.array(kept, dtype=np.float64)


def test_rate_is_that_of_the_profile_from_the_first_frame_on() -> None:
    count = np.diff([in_empty_scene(perfect_with(), frames=20, seed=seed).start for seed in range(300)], axis=1)
    assert count.mean() == pytest.approx(2.0, rel=0.05)
    assert count[:, 0].mean() == pytest.approx(2.0, rel=0.12)
    assert count[:, -1].mean() == pytest.approx(2.0, rel=0.12)


@pytest.mark.parametrize(
    ("view", "dispersion", "rate", "expected"),
    [
        pytest.param(90.0, 1.0, 2.0, 1.0, id="scenes alike"),
        pytest.param(90.0, 2.5, 2.0, 2.5, id="scenes that differ"),
        pytest.param(30.0, 1.5, 6.0, 2.5, id="a sensor that covers more of the circle than the fitted one"),
    ],
)
def test_counts_vary_between_scenes_as_stated(view: float, dispersion: float, rate: float, expected: float) -> None:
    profile = perfect_with(dispersion=dispersion).model_copy(update={"field_of_view": view})
    count = np.diff([in_empty_scene(profile, frames=10, seed=seed).start for seed in range(600)], axis=1)
    assert count.mean() == pytest.approx(rate, rel=0.1)
    assert count.var() / count.mean() == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("steps", "share"), [(1.0, 0.4), (3.0, 0.4**3)])
def test_boxes_survive_geometrically_at_the_period_of_the_frames(steps: float, share: float) -> None:
    assert _survivors(in_empty_scene(perfect_with(), dt=steps * DT)).mean() == pytest.approx(share, abs=0.025)


def test_places_are_even_over_bearing_in_view_and_over_distance_unless_the_profile_says_otherwise() -> None:
    ego = np.tile([100.0, -50.0, 2.0, 2.0], (4000, 1))
    box = in_empty_scene(perfect_with(survive=0.0), ego=ego).box
    dx, dy = box[:, 0] - 100.0, box[:, 1] + 50.0
    distance = np.hypot(dx, dy)
    bearing = np.remainder(np.arctan2(dy, dx) - 2.0 + np.pi, 2 * np.pi) - np.pi
    tenths = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(np.quantile(distance, tenths), 2.0 + 58.0 * tenths, atol=1.5)
    np.testing.assert_allclose(np.quantile(bearing, tenths), (tenths - 0.5) * np.pi / 2, atol=0.04)
    np.testing.assert_allclose(np.quantile(box[:, 3], tenths), (tenths - 0.5) * 2 * np.pi, atol=0.15)


def test_distances_have_the_quantiles_of_the_profile() -> None:
    law = (3.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0, 30.0, 55.0)
    box = in_empty_scene(perfect_with(survive=0.0, distance=law)).box
    distance = np.hypot(box[:, 0], box[:, 1])
    np.testing.assert_allclose(np.quantile(distance, np.linspace(0, 1, 11)), law, atol=0.7)
    assert np.quantile(distance, 0.95) == pytest.approx(42.5, abs=2.0)  # evenly in between


def test_a_shorter_reach_leaves_the_others_as_they_are() -> None:
    profile = noisy(false_positives={**FALSE_POSITIVES, "survive": 0.7}, z=(0.0, 0.1), velocity=0.2)
    profile = profile.model_copy(update={"field_of_view": 90.0})
    far, near = (
        simulate(nothing(500), np.zeros((500, 4)), ("car",), profile, Sensor(reach, np.pi / 2), 0, DT)
        for reach in (60.0, 31.0)
    )
    assert len(near.box) == pytest.approx(0.5 * len(far.box), rel=0.1)
    np.testing.assert_array_equal(near.box, far.box[np.hypot(far.box[:, 0], far.box[:, 1]) <= 31.0])


def test_what_appears_beyond_the_reach_does_not_come_into_view_later() -> None:
    ego = np.zeros((300, 4))
    ego[:, 0] = np.arange(300.0)
    law = perfect_with(survive=0.95, distance=(80.0,) * 11)
    assert len(in_empty_scene(law, ego=ego).box) == 0


def test_boxes_stand_still_while_the_sensor_drives_past_them() -> None:
    frames = 400
    ego = np.zeros((frames, 4))
    ego[:, 0] = np.arange(frames) * 2.0
    detections = in_empty_scene(perfect_with(survive=0.9), ego=ego)
    frame = detections.frame_of_rows
    assert _survivors(detections).mean() > 0.7
    ahead = detections.box[:, :2] - ego[frame, :2]
    assert (np.hypot(*ahead.T) <= 60.0).all()
    assert (np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])) <= np.pi / 4).all()


def test_looks_are_around_the_mean_of_the_class() -> None:
    detections = in_empty_scene(perfect_with(survive=0.0))
    np.testing.assert_allclose(detections.box[:, 4:].mean(0), [4.0, 1.8, 1.5], rtol=0.01)
    np.testing.assert_allclose(detections.box[:, 4:].std(0), [0.4, 0.18, 0.15], rtol=0.05)
    np.testing.assert_allclose(detections.box[:, 2], detections.box[:, 6] / 2)  # on the ground at the ego's feet
    assert detections.score.mean() == pytest.approx(3.0, abs=0.03)
    assert detections.score.std() == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(detections.velocity.std(0), [0.2, 0.2], rtol=0.05)
    np.testing.assert_allclose(detections.velocity.mean(0), [0.0, 0.0], atol=0.01)


def test_boxes_stand_where_the_true_ones_stand() -> None:
    truth = truth_of(np.zeros(3, int), np.arange(3), np.tile([5.0, 0, -1.0, 0, 4.0, 2.0, 1.4], (3, 1)), frames=200)
    detections = simulate(truth, np.zeros((200, 4)), ("car",), perfect_with(), AHEAD, 0, DT)
    np.testing.assert_allclose((detections.box[:, 2] - detections.box[:, 6] / 2), -1.7)


def test_scores_stay_above_the_floor() -> None:
    profile = noisy(false_positives=FALSE_POSITIVES, score={"quadratic": (5.0, 0.0, 0.0), "floor": 2.9, "ceiling": 3.2})
    score = in_empty_scene(profile, frames=6000).score
    law = stats.truncnorm(-0.2, 0.4, loc=3.0, scale=0.5)
    assert stats.kstest(score, law.cdf).statistic < 0.05
    assert len(np.unique(score)) == len(score)


def test_errors_are_those_of_true_objects() -> None:
    """The detections of a false positive differ from frame to frame as those of a standing object do."""
    axis = {"s0": 0.05, "s1": 0.0, "nu": 8.0, **MEMORY}
    noise: dict[str, Any] = {"radial": axis, "tangential": axis, "z": (0.1, 0.05), "velocity": 0.2}
    noise |= {"heading": {"scale": 0.03, "flip": 0.05, "flip_again": 0.5}}
    noise |= {"size": {"deviation": (0.2, 0.1, 0.1), "white": 0.3}}
    law = {**FALSE_POSITIVES, "survive": 0.9, "rate": 0.1}
    found = in_empty_scene(noisy(**noise, false_positives=law).model_copy(update={"field_of_view": 90.0}), 8000)
    frame, box = found.frame_of_rows, found.box
    step = np.flatnonzero((np.diff(frame) == 1) & (np.hypot(*np.diff(box[:, :2], axis=0).T) < 0.5))
    change = box[step + 1] - box[step]
    radius = box[step, :2] / np.hypot(box[step, 0], box[step, 1])[:, None]
    kept = 0.2 + 0.5 * 0.8  # correlation of position errors between frames
    assert (change[:, :2] * radius).sum(1).std() == pytest.approx(0.05 * np.sqrt(8 / 6 * 2 * (1 - kept)), rel=0.15)
    assert change[:, 2].std() == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert change[:, 4].std() == pytest.approx(0.2 * np.sqrt(2 * 0.3), rel=0.1)
    turned = np.abs(wrap_angle(change[:, 3])) > np.pi / 2
    assert turned.mean() == pytest.approx(2 * 0.05 * 0.5 / 0.55, rel=0.3)
    assert (box[:, 2] - box[:, 6] / 2).mean() == pytest.approx(0.1, abs=0.03)


def test_classes_of_one_noise_share_its_false_positives_as_their_true_boxes() -> None:
    profile, classes = profile1("nuscenes_megvii"), ("truck", "car", "bus", "pedestrian")
    box = np.tile([500.0, 0.0, 1.5, 0.0, 9.0, 2.5, 3.0], (4, 1))  # out of reach: only their number matters
    truth = truth_of(np.zeros(4, int), np.arange(4), box, frames=600)
    truth = replace(truth, class_id=np.array([0, 0, 0, 2]))
    found = simulate(truth, np.zeros((600, 4)), classes, profile, AHEAD, 3, 0.5)
    vehicle = found.class_id[found.class_id < 3]
    assert len(vehicle) > 50
    assert (vehicle == 0).mean() == pytest.approx(0.75, abs=0.12)
    assert (vehicle == 1).sum() == 0
    assert (found.class_id == 3).sum() > 50, "no pedestrian is there: the class itself"
    np.testing.assert_allclose(np.median(found.box[found.class_id == 0, 4:], axis=0), [9.0, 2.5, 3.0], rtol=0.1)


def test_without_true_boxes_it_is_the_class_that_has_the_noise() -> None:
    profile, truth, ego = profile1("nuscenes_megvii"), nothing(200), np.zeros((200, 4))
    for classes, expected in ((("truck", "car", "pedestrian"), {1, 2}), (("truck", "bus"), {0})):
        assert set(simulate(truth, ego, classes, profile, AHEAD, 0, 0.5).class_id.tolist()) == expected
