"""What the simulated detector owes by either model: determinism, order of rows, and what no noise means."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from mtp_bench.detector import load_profile, profile_names
from mtp_bench.detector.sight import Sensor, covered
from mtp_bench.detector.simulate import simulate
from mtp_bench.errors import ShapeError
from mtp_bench.types import Detections, Truth
from tests.support.detector_scenes import DT, nothing, traffic

SENSOR = Sensor(reach=50.0, field_of_view=np.pi)
TRAFFIC = ("car", "truck", "pedestrian")
MEGVII = ["nuscenes_megvii", "v1/nuscenes_megvii"]


def _same(a: Detections, b: Detections) -> bool:
    return all(np.array_equal(getattr(a, key), getattr(b, key), equal_nan=True) for key in vars(a))


def _digest(detections: Detections) -> str:
    return hashlib.sha256(b"".join(np.round(value, 6).tobytes() for value in vars(detections).values())).hexdigest()


@pytest.mark.parametrize(
    "name", sorted({*profile_names(), *profile_names(1)} - {"wildtrack_mvdet", "v1/wildtrack_mvdet"})
)  # people only
def test_the_same_arguments_give_the_same_detections_and_another_seed_others(name: str) -> None:
    truth, ego = traffic()
    profile = load_profile(name)
    first, again, other = (simulate(truth, ego, TRAFFIC, profile, SENSOR, seed, DT) for seed in (3, 3, 4))
    assert _same(first, again)
    assert _same(first, other) == (name.removeprefix("v1/") == "clean")
    assert len(first.box) > 50


@pytest.mark.parametrize("name", MEGVII)
def test_another_process_with_another_hash_seed_gives_the_same_detections(name: str) -> None:
    truth, ego = traffic()
    here = _digest(simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 3, DT))
    code = (
        "from tests.detector.test_simulate import *; from tests.detector.test_simulate import _digest;"
        f"print(_digest(simulate(*traffic(), TRAFFIC, load_profile('{name}'), SENSOR, 3, DT)))"
    )
    there = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONHASHSEED": "77"}, capture_output=True, text=True, check=True
    )
    assert there.stdout.strip() == here


@pytest.mark.parametrize("name", ["clean", "v1/clean"])
def test_without_noise_the_detections_are_the_covered_true_boxes(name: str) -> None:
    truth, ego = traffic()
    found = simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 0, DT)
    inside = covered(truth, ego, SENSOR)
    assert 50 < inside.sum() < len(inside)
    for t in range(len(ego)):
        rows, mine = truth.rows(t), found.rows(t)
        true = np.column_stack([truth.box, truth.velocity, truth.class_id])[rows][inside[rows]]
        got = np.column_stack([found.box, found.velocity, found.class_id])[mine]
        np.testing.assert_allclose(got, true[np.argsort(true[:, 0])], atol=1e-12)
    assert (found.score == 1.0).all()


@pytest.mark.parametrize("name", MEGVII)
def test_rows_of_a_frame_are_by_score_and_do_not_tell_the_object(name: str) -> None:
    truth, ego = traffic()
    found = simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 0, DT)
    for t in range(len(ego)):
        score, x = found.score[found.rows(t)], found.box[found.rows(t), 0]
        assert (np.diff(score) <= 0).all()
        assert (np.diff(x)[np.diff(score) == 0] >= 0).all()


@pytest.mark.parametrize("name", MEGVII)
def test_the_order_of_true_rows_within_a_frame_does_not_matter(name: str) -> None:
    truth, ego = traffic()
    rng = np.random.default_rng(0)
    order = np.concatenate([rng.permutation(np.arange(len(truth.box))[truth.rows(t)]) for t in range(len(ego))])
    shuffled = Truth(truth.start, *(value[order] for key, value in vars(truth).items() if key != "start"))
    profile = load_profile(name)
    a, b = (simulate(each, ego, TRAFFIC, profile, SENSOR, 2, DT) for each in (truth, shuffled))
    np.testing.assert_allclose(b.box, a.box, atol=1e-9)


def test_a_pose_per_frame_is_needed() -> None:
    truth, ego = traffic()
    with pytest.raises(ShapeError, match=r"ego has shape \(29, 4\), expected \(30, 4\)"):
        simulate(truth, ego[:-1], TRAFFIC, load_profile("clean"), SENSOR, 0, DT)


@pytest.mark.parametrize("name", MEGVII)
@pytest.mark.parametrize("frames", [0, 1, 3])
def test_a_scene_without_objects_can_be_simulated(frames: int, name: str) -> None:
    truth, ego = nothing(frames), np.zeros((frames, 4))
    found = simulate(truth, ego, TRAFFIC, load_profile(name), SENSOR, 0, DT)
    assert found.frames == frames
    clean = simulate(truth, ego, TRAFFIC, load_profile("clean"), SENSOR, 0, DT)
    assert clean.start.tolist() == [0] * (frames + 1)
    assert clean.box.shape == (0, 7)


@pytest.mark.parametrize("name", MEGVII)
def test_a_class_without_noise_of_its_own_is_a_false_positive_too(name: str) -> None:
    """A class that is lent its noise would else tell that the box is true."""
    truth, ego = traffic(frames=200)
    classes = ("car", "pedestrian", "cyclist")  # cyclists are lent the noise of cars
    profile = load_profile(name)
    assert profile.noise_name("cyclist") == profile.noise_name("bicycle") == "car"
    lent = Truth(**{**vars(truth), "class_id": truth.object_id % 3})
    found = simulate(lent, ego, classes, profile, SENSOR, 0, DT)
    far = np.zeros(len(classes), dtype=int)
    for t in range(len(ego)):
        rows, mine = lent.rows(t), found.rows(t)
        apart = np.linalg.norm(found.box[mine, None, :2] - lent.box[None, rows, :2], axis=-1).min(axis=1)
        far += np.bincount(found.class_id[mine][apart > 4.0], minlength=len(classes))
    assert (far > 0).all()
