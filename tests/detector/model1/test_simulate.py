"""Model 1 as a whole: streams, rigid motions, classes that are alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mtp_bench.detector import Profile1
from mtp_bench.detector.model1.draws import Kind, Whose
from mtp_bench.detector.sight import Sensor
from mtp_bench.detector.simulate import simulate
from mtp_bench.geometry import transform_boxes
from mtp_bench.types import Floats, Truth
from tests.support.detector_scenes import DT, MEMORY, crowd, detect, on_grid, seen_at, traffic
from tests.support.model1_scenes import FALSE_POSITIVES, missing, noisy, profile1

SENSOR = Sensor(reach=50.0, field_of_view=np.pi)
TRAFFIC = ("car", "truck", "pedestrian")
FULL: dict[str, Any] = {
    "miss": missing(-1.0, 2.0),
    "radial": {"s0": 0.05, "s1": 0.02, "nu": 4.0, **MEMORY},
    "tangential": {"s0": 0.05, "s1": 0.02, "nu": 4.0, **MEMORY},
    "heading": {"scale": 0.05, "flip": 0.03, "flip_again": 0.3},
    "size": {"deviation": (0.3, 0.2, 0.1)},
    "z": (0.0, 0.1),
    "score": {"quadratic": (5.0, -0.5, 0.0), "deviation": 0.4, "floor": -50.0, "ceiling": None, **MEMORY},
    "velocity": 0.2,
}


_COLUMNS = {"position": slice(0, 2), "z": slice(2, 3), "heading": slice(3, 4), "size": slice(4, 7)}


@pytest.mark.parametrize(
    ("name", "change", "moved"),
    [
        ("radial", {"radial": {"s0": 0.4, "s1": 0.1, "nu": 3.0, **MEMORY}}, "position"),
        ("tangential", {"tangential": {"s0": 0.4, "s1": 0.1, "nu": 3.0, **MEMORY}}, "position"),
        ("heading", {"heading": {"scale": 0.2, "flip": 0.03, "flip_again": 0.3}}, "heading"),
        ("flips", {"heading": {"scale": 0.05, "flip": 0.3, "flip_again": 0.6}}, "heading"),
        ("size", {"size": {"deviation": (0.6, 0.4, 0.2)}}, "size"),
        ("height", {"z": (0.3, 0.3)}, "z"),
        ("score", {"score": {**FULL["score"], "deviation": 0.9}}, "score"),
        ("velocity", {"velocity": 0.9}, "velocity"),
    ],
)
def test_a_changed_level_leaves_every_other_figure_alone(name: str, change: dict[str, Any], moved: str) -> None:
    truth = crowd(30, 40)
    before, after = (
        on_grid(detect(truth, noisy(**{**FULL, **levels}), seen_at(truth, 20.0)), 40) for levels in ({}, change)
    )
    np.testing.assert_array_equal(after[0], before[0], err_msg=name)  # undetected
    figures = {key: (before[1][..., part], after[1][..., part]) for key, part in _COLUMNS.items()}
    figures |= {"velocity": (before[2], after[2]), "score": (before[3], after[3])}
    changed = {key for key, (old, new) in figures.items() if not np.array_equal(old, new, equal_nan=True)}
    assert changed == {moved}, name


def test_more_undetected_objects_take_detections_away_and_change_none_of_the_others() -> None:
    truth = crowd(30, 40)
    few, many = (
        on_grid(detect(truth, noisy(**{**FULL, "miss": missing(base, 2.0)}), seen_at(truth, 20.0)), 40)
        for base in (-1.0, 0.0)
    )
    assert many[0].sum() < few[0].sum()
    assert (few[0] | ~many[0]).all()
    for less, more in zip(many[1:], few[1:], strict=True):
        np.testing.assert_array_equal(less[many[0]], more[many[0]])


def test_false_positives_and_duplicates_change_no_detection() -> None:
    truth = crowd(30, 40)
    law = {**FALSE_POSITIVES, "dispersion": 2.0}
    plain = detect(truth, noisy(**FULL), seen_at(truth, 20.0))
    more = detect(truth, noisy(**FULL, duplicates=0.3, false_positives=law), seen_at(truth, 20.0))
    assert len(more.box) > len(plain.box) + 100
    assert {tuple(row) for row in plain.box} <= {tuple(row) for row in more.box}


def test_kinds_of_noise_have_different_streams_for_good() -> None:
    assert [kind.value for kind in Kind] == list(range(17))
    numbers = [streams.value + kind.value for streams in Whose for kind in Kind]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize(
    ("yaw", "shift"), [(0.0, (100.0, -50.0, 3.0)), (1.2, (0.0, 0.0, 0.0)), (-2.9, (5e3, 7e3, -9.0))]
)
def test_detections_move_with_the_world(yaw: float, shift: tuple[float, float, float]) -> None:
    truth, ego = traffic()
    law = {**FALSE_POSITIVES, "dispersion": 2.0}
    profile = noisy(**{**FULL, "score": {**FULL["score"], "deviation": 1.0}}, duplicates=0.1, false_positives=law)
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    moved_truth = Truth(
        **{**vars(truth), "box": transform_boxes(truth.box, yaw, shift), "velocity": truth.velocity @ turn}
    )
    moved_ego = np.column_stack([ego[:, :2] @ turn + shift[:2], ego[:, 2] + shift[2], ego[:, 3] + yaw])
    here = simulate(truth, ego, TRAFFIC, profile, SENSOR, 1, DT)
    there = simulate(moved_truth, moved_ego, TRAFFIC, profile, SENSOR, 1, DT)
    np.testing.assert_array_equal(there.start, here.start)
    expected = transform_boxes(here.box, yaw, shift)
    np.testing.assert_allclose(there.box[:, [0, 1, 2, 4, 5, 6]], expected[:, [0, 1, 2, 4, 5, 6]], atol=1e-6)
    np.testing.assert_allclose(np.cos(there.box[:, 3] - expected[:, 3]), 1.0, atol=1e-9)
    np.testing.assert_allclose(there.velocity, here.velocity @ turn, atol=1e-9)
    np.testing.assert_allclose(there.score, here.score, atol=1e-9)
    np.testing.assert_array_equal(there.class_id, here.class_id)


def _classes_of(profile: Profile1, class_id: int) -> Floats:
    truth = crowd(20, 30)
    truth = Truth(**{**vars(truth), "class_id": np.full(len(truth.box), class_id)})
    names = ("car", "truck", "pedestrian")
    return simulate(truth, np.zeros((20, 4)), names, profile, SENSOR, 0, DT, seen_at(truth, 20.0)).box


def test_a_class_that_is_alike_has_the_noise_of_the_other() -> None:
    profile = profile1("kitti_pointrcnn").model_copy(update={"alike": {"truck": "car"}})
    quiet = {name: noise.model_copy(update={"false_positives": None}) for name, noise in profile.classes.items()}
    profile = profile.model_copy(update={"classes": quiet})
    np.testing.assert_array_equal(_classes_of(profile, 1), _classes_of(profile, 0))
    assert len(_classes_of(profile, 2)) != len(_classes_of(profile, 0))


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_an_empty_scene_has_empty_frames(frames: int) -> None:
    found = detect(crowd(frames, 0), noisy(**FULL), seen_at(crowd(frames, 0), 20.0))
    assert found.start.tolist() == [0] * (frames + 1)
    assert found.box.shape == (0, 7)
