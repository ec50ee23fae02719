"""False positives of a simulated detector: rate, dispersion, survival, places, looks, and who emits them."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.detector import load_profile
from mtp_bench.detector.sight import frame_of_rows
from mtp_bench.detector.simulate import simulate
from mtp_bench.types import Detections, Floats
from tests.detector_scenes import AHEAD, CLUTTER, DT, clutter, cluttered, noisy, nothing, truth_of


def _survivors(detections: Detections) -> Floats:
    """Whether each box that has a next frame is there in it too, at the same place."""
    frame = frame_of_rows(detections.start)
    places = {(int(t), float(x)) for t, x in zip(frame, detections.box[:, 0], strict=True)}
    last = len(detections.start) - 2
    kept = [(t + 1, float(x)) in places for t, x in zip(frame, detections.box[:, 0], strict=True) if t < last]
    return np.array(kept, dtype=np.float64)


def test_rate_is_that_of_the_profile_from_the_first_frame_on() -> None:
    count = np.diff([clutter(cluttered(), frames=20, seed=seed).start for seed in range(300)], axis=1)
    assert count.mean() == pytest.approx(2.0, rel=0.05)
    assert count[:, 0].mean() == pytest.approx(2.0, rel=0.12)
    assert count[:, -1].mean() == pytest.approx(2.0, rel=0.12)


@pytest.mark.parametrize("dispersion", [1.0, 2.5])
def test_counts_vary_between_scenes_as_stated(dispersion: float) -> None:
    profile = cluttered(dispersion=dispersion)
    count = np.diff([clutter(profile, frames=10, seed=seed).start for seed in range(600)], axis=1)
    assert count.var() / count.mean() == pytest.approx(dispersion, rel=0.15)
    assert count.mean() == pytest.approx(2.0, rel=0.1)


def test_a_sensor_that_covers_more_of_the_circle_has_more_of_it() -> None:
    profile = cluttered(dispersion=1.5).model_copy(update={"field_of_view": 30.0})
    count = np.diff([clutter(profile, frames=10, seed=seed).start for seed in range(600)], axis=1)
    assert count.mean() == pytest.approx(6.0, rel=0.1)
    assert count.var() / count.mean() == pytest.approx(2.5, rel=0.15), "scenes differ as much as before, relatively"


@pytest.mark.parametrize(("steps", "share"), [(1.0, 0.4), (3.0, 0.4**3)])
def test_boxes_survive_geometrically_at_the_period_of_the_frames(steps: float, share: float) -> None:
    assert _survivors(clutter(cluttered(), dt=steps * DT)).mean() == pytest.approx(share, abs=0.025)


def test_places_are_even_over_distance_and_bearing_in_view() -> None:
    ego = np.tile([100.0, -50.0, 2.0, 2.0], (4000, 1))
    box = clutter(cluttered(survive=0.0), ego=ego).box
    dx, dy = box[:, 0] - 100.0, box[:, 1] + 50.0
    distance = np.hypot(dx, dy)
    bearing = np.remainder(np.arctan2(dy, dx) - 2.0 + np.pi, 2 * np.pi) - np.pi
    tenths = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(np.quantile(distance, tenths), 60.0 * tenths, atol=1.5)
    np.testing.assert_allclose(np.quantile(bearing, tenths), (tenths - 0.5) * np.pi / 2, atol=0.04)
    np.testing.assert_allclose(np.quantile(box[:, 3], tenths), (tenths - 0.5) * 2 * np.pi, atol=0.15)


def test_boxes_stand_still_while_the_sensor_drives_past_them() -> None:
    frames = 400
    ego = np.zeros((frames, 4))
    ego[:, 0] = np.arange(frames) * 2.0
    detections = clutter(cluttered(survive=0.9), ego=ego)
    frame = frame_of_rows(detections.start)
    assert _survivors(detections).mean() > 0.7
    ahead = detections.box[:, :2] - ego[frame, :2]
    assert (np.hypot(*ahead.T) <= 60.0).all()
    assert (np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])) <= np.pi / 4).all()


def test_looks_are_around_the_mean_of_the_class() -> None:
    detections = clutter(cluttered(survive=0.0))
    np.testing.assert_allclose(detections.box[:, 4:].mean(0), [4.0, 1.8, 1.5], rtol=0.01)
    np.testing.assert_allclose(detections.box[:, 4:].std(0), [0.4, 0.18, 0.15], rtol=0.05)
    np.testing.assert_allclose(detections.box[:, 2], detections.box[:, 6] / 2)  # on the ground at the ego's feet
    assert detections.score.mean() == pytest.approx(3.0, abs=0.03)
    assert detections.score.std() == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(detections.velocity.std(0), [0.2, 0.2], rtol=0.05)
    np.testing.assert_allclose(detections.velocity.mean(0), [0.0, 0.0], atol=0.01)


def test_boxes_stand_where_the_true_ones_stand() -> None:
    truth = truth_of(np.zeros(3, int), np.arange(3), np.tile([5.0, 0, -1.0, 0, 4.0, 2.0, 1.4], (3, 1)), frames=200)
    detections = simulate(truth, np.zeros((200, 4)), ("car",), cluttered(), AHEAD, 0, DT)
    np.testing.assert_allclose((detections.box[:, 2] - detections.box[:, 6] / 2), -1.7)


def test_scores_stay_above_the_floor() -> None:
    profile = noisy(false_positives=CLUTTER, score={"quadratic": (5.0, 0.0, 0.0), "floor": 2.9, "ceiling": 3.2})
    score = clutter(profile, frames=300).score
    assert (score.min(), score.max()) == (2.9, 3.2)


def test_a_class_that_borrows_its_noise_emits_none() -> None:
    profile, truth, ego = load_profile("nuscenes_megvii"), nothing(200), np.zeros((200, 4))
    classes = ("truck", "car", "bus", "pedestrian")
    emitted = simulate(truth, ego, classes, profile, AHEAD, 0, 0.5).class_id
    assert set(emitted.tolist()) == {1, 3}
    assert len(simulate(truth, ego, ("truck", "bus"), profile, AHEAD, 0, 0.5).box) == 0
