"""The simulated detector as a whole: streams, determinism, order of rows, rigid motions, and what no noise means."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from mtp_bench.detector import Profile, load_profile, profile_names
from mtp_bench.detector.draws import Kind, Whose
from mtp_bench.detector.sight import Sensor, covered
from mtp_bench.detector.simulate import simulate
from mtp_bench.errors import ShapeError
from mtp_bench.geometry import transform_boxes
from mtp_bench.types import Detections, Floats, Truth
from tests.support.detector_scenes import (
    DT,
    FALSE_POSITIVES,
    MEMORY,
    crowd,
    detect,
    grid_truth,
    missing,
    noisy,
    on_grid,
    profile1,
    seen_at,
)

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


def _traffic(frames: int = 30, objects: int = 20) -> tuple[Truth, Floats]:
    """Objects of three classes on straight ways in the plane, a sensor that drives through them, its poses."""
    rng = np.random.default_rng(5)
    place, velocity = rng.uniform(-60, 60, (objects, 2)), rng.normal(0, 4, (objects, 2))
    box = np.zeros((frames, objects, 7))
    box[..., :2] = place + np.arange(frames)[:, None, None] * DT * velocity
    box[..., 2] = 0.8
    box[..., 3] = np.arctan2(velocity[:, 1], velocity[:, 0])
    box[..., 4:] = np.array([[4.5, 1.9, 1.6], [9.0, 2.5, 3.0], [0.8, 0.7, 1.7]])[np.arange(objects) % 3]
    truth = grid_truth(box, velocity, np.arange(objects) % 3, rng.permutation(objects) * 7 + 100)
    ego = np.zeros((frames, 4))
    ego[:, 0], ego[:, 3] = np.arange(frames) * 0.8, np.linspace(0, 0.6, frames)
    return truth, ego


def _same(a: Detections, b: Detections) -> bool:
    return all(np.array_equal(getattr(a, key), getattr(b, key), equal_nan=True) for key in vars(a))


def _digest(detections: Detections) -> str:
    return hashlib.sha256(b"".join(np.round(value, 6).tobytes() for value in vars(detections).values())).hexdigest()


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
    "name", sorted({*profile_names(), *profile_names(1)} - {"wildtrack_mvdet", "v1/wildtrack_mvdet"})
)  # people only
def test_the_same_arguments_give_the_same_detections_and_another_seed_others(name: str) -> None:
    truth, ego = _traffic()
    profile = load_profile(name)
    first, again, other = (simulate(truth, ego, TRAFFIC, profile, SENSOR, seed, DT) for seed in (3, 3, 4))
    assert _same(first, again)
    assert _same(first, other) == (name.removeprefix("v1/") == "clean")
    assert len(first.box) > 50


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_another_process_with_another_hash_seed_gives_the_same_detections(name: str) -> None:
    truth, ego = _traffic()
    here = _digest(simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 3, DT))
    code = (
        "from tests.detector.test_simulate import *; from tests.detector.test_simulate import _digest, _traffic;"
        f"print(_digest(simulate(*_traffic(), TRAFFIC, load_profile('{name}'), SENSOR, 3, DT)))"
    )
    there = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONHASHSEED": "77"}, capture_output=True, text=True, check=True
    )
    assert there.stdout.strip() == here


@pytest.mark.parametrize("name", ["clean", "v1/clean"])
def test_without_noise_the_detections_are_the_covered_true_boxes(name: str) -> None:
    truth, ego = _traffic()
    found = simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 0, DT)
    inside = covered(truth, ego, SENSOR)
    assert 50 < inside.sum() < len(inside)
    for t in range(len(ego)):
        rows, mine = truth.rows(t), found.rows(t)
        true = np.column_stack([truth.box, truth.velocity, truth.class_id])[rows][inside[rows]]
        got = np.column_stack([found.box, found.velocity, found.class_id])[mine]
        np.testing.assert_allclose(got, true[np.argsort(true[:, 0])], atol=1e-12)
    assert (found.score == 1.0).all()


@pytest.mark.parametrize(
    ("yaw", "shift"), [(0.0, (100.0, -50.0, 3.0)), (1.2, (0.0, 0.0, 0.0)), (-2.9, (5e3, 7e3, -9.0))]
)
def test_detections_move_with_the_world(yaw: float, shift: tuple[float, float, float]) -> None:
    truth, ego = _traffic()
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


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_rows_of_a_frame_are_by_score_and_do_not_tell_the_object(name: str) -> None:
    truth, ego = _traffic()
    found = simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 0, DT)
    for t in range(len(ego)):
        score, x = found.score[found.rows(t)], found.box[found.rows(t), 0]
        assert (np.diff(score) <= 0).all()
        assert (np.diff(x)[np.diff(score) == 0] >= 0).all()


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_the_order_of_true_rows_within_a_frame_does_not_matter(name: str) -> None:
    truth, ego = _traffic()
    rng = np.random.default_rng(0)
    order = np.concatenate([rng.permutation(np.arange(len(truth.box))[truth.rows(t)]) for t in range(len(ego))])
    shuffled = Truth(truth.start, *(value[order] for key, value in vars(truth).items() if key != "start"))
    profile = load_profile(name)
    a, b = (simulate(each, ego, TRAFFIC, profile, SENSOR, 2, DT) for each in (truth, shuffled))
    np.testing.assert_allclose(b.box, a.box, atol=1e-9)


def _classes_of(profile: Profile, class_id: int) -> Floats:
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


def test_a_pose_per_frame_is_needed() -> None:
    truth, ego = _traffic()
    with pytest.raises(ShapeError, match=r"ego has shape \(29, 4\), expected \(30, 4\)"):
        simulate(truth, ego[:-1], TRAFFIC, load_profile("clean"), SENSOR, 0, DT)


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_an_empty_scene_has_empty_frames(frames: int) -> None:
    found = detect(crowd(frames, 0), noisy(**FULL), seen_at(crowd(frames, 0), 20.0))
    assert found.start.tolist() == [0] * (frames + 1)
    assert found.box.shape == (0, 7)
