"""Motion noise: what is stored, and that a fit finds what made the windows."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Bools, Floats
from mtp_bench.prediction import NoiseTable, kalman, stored_noise
from mtp_bench.prediction.kalman import condition, noise_table
from mtp_bench.tracking import HypothesisTracker, TruthTracker
from mtp_bench.training.motion_noise import as_toml, collect, fit_motion_noise, fit_scenes, forecast_score
from tests.support.scoring_scenes import end_to_end
from tests.support.small_scenes import bare_scene, make_scene
from tests.support.tracking_scenes import kitti_task

DT = 0.1
TRUE: dict[str, Any] = {"measurement": 0.1, "jerkiness": [1.2, 0.4], "speed": [4.0, 0.5], "acceleration": [0.8, 0.3]}


def simulated(rng: np.random.Generator, n: int) -> tuple[Floats, Bools, Floats]:
    """Past [n, 10, 2] and future [n, 10, 2] of motions with exactly the noise of TRUE, and the mask of the past."""
    fine = 20  # steps of the simulation per frame
    jerk, speed, acceleration = (np.array(TRUE[name]) for name in ("jerkiness", "speed", "acceleration"))
    velocity = rng.normal(size=(n, 2)) * speed
    position, past = np.zeros((n, 2)), []
    for _ in range(10):
        past.append(position)
        for _ in range(fine):
            position = position + velocity * DT / fine
            velocity = velocity + rng.normal(size=(n, 2)) * jerk * np.sqrt(DT / fine)
    # Now is the frame after the last of the loop.
    past = [*past[1:], position]
    tau = DT * np.arange(1, 11)[:, None]
    push = rng.normal(size=(n, 1, 2)) * acceleration
    future = position[:, None] + velocity[:, None] * tau + push * tau**2 / 2
    seen = np.stack(past, axis=1) + rng.normal(size=(n, 10, 2)) * TRUE["measurement"]
    valid = rng.random((n, 10)) < 0.9
    origin = seen[:, -1:]
    return seen - origin, valid, future - origin


def test_a_fit_finds_the_noise_that_made_the_windows() -> None:
    position, valid, future = simulated(np.random.default_rng(0), 1500)
    found = fit_motion_noise(position, valid, future, DT)
    assert found["measurement"] == pytest.approx(TRUE["measurement"], rel=0.25)
    for name in ("jerkiness", "acceleration"):
        np.testing.assert_allclose(found[name], TRUE[name], rtol=0.35)
    fresh = simulated(np.random.default_rng(1), 1500)
    reached, best = (forecast_score(*fresh, noise_table([row]), DT) for row in (found, TRUE))
    assert reached < 1.01 * best


CONDITIONS: dict[str, dict[str, Any]] = {
    "KITTI-pointrcnn-world": {}, "KITTI-pointrcnn-ego": {"ego_motion": False},
    "KITTI-truth-world": {"observe": "truth"}, "KITTI-truth-ego": {"observe": "truth", "ego_motion": False},
}  # fmt: skip


@pytest.mark.parametrize("name", CONDITIONS)
def test_stored_noise(name: str) -> None:
    task = kitti_task(motion_noise="KITTI", **CONDITIONS[name])
    assert condition(task) == name
    noise = stored_noise(task)
    for field in fields(NoiseTable):
        value = getattr(noise, field.name)
        assert value.shape == ((3,) if field.name == "measurement" else (3, 2))
        assert (value > 0).all()
    # Classes come in the order of the task.
    swapped = stored_noise(replace(task, classes=("cyclist", "car")))
    np.testing.assert_array_equal(swapped.jerkiness, noise.jerkiness[[2, 0]])


STORE: dict[str, dict[str, Any]] = {
    "KITTI-pointrcnn-world": {"car": {**TRUE, "measurement": 1.0}, "cyclist": {**TRUE, "measurement": 1.5}},
    "KITTI-truth-world": {"car": {**TRUE, "measurement": 2.0}},
    "Merge-kitti_pointrcnn-world": {"car": {**TRUE, "measurement": 3.0}},
    "Merge-clean-world": {"car": {**TRUE, "measurement": 4.0}},
}
LIKE: dict[str, tuple[dict[str, Any], float]] = {
    "own": ({"motion_noise": "Merge", "detector": "clean"}, 4.0),
    "another variant": ({"motion_noise": "Merge", "detector": "kitti_pointrcnn-iid"}, 3.0),
    "the same detector under another name": ({"motion_noise": "Merge", "detector": "pointrcnn"}, 3.0),
    "another detector of the domain": ({"motion_noise": "Merge", "detector": "lidar"}, 3.0),
    "another domain": ({"motion_noise": "mine", "detector": "pointrcnn"}, 1.0),
    "no domain: by the detector alone": ({"detector": "pointrcnn"}, 1.0),
    "no domain and another family of it": ({"detector": "kitti_pointrcnn"}, 3.0),
    "another domain that knows the class": ({"motion_noise": "Merge", "classes": ("cyclist",)}, 1.5),
    "truth of another domain": ({"motion_noise": "Merge", "observe": "truth"}, 2.0),
}


@pytest.mark.parametrize("name", LIKE)
def test_the_most_similar_condition_stands_in(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kalman, "_read_folder", lambda _: STORE)
    changes, measurement = LIKE[name]
    assert stored_noise(kitti_task(**{"classes": ("car",), **changes})).measurement[0] == measurement


def test_a_file_in_the_folder_is_a_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kalman, "FOLDER", tmp_path)
    rows = {"car": TRUE, "pedestrian": {**TRUE, "measurement": 0.03}}
    for domain, order in (("Aachen", "order = 2\n"), ("Mine", "order = 1\n"), ("Last", "")):
        (tmp_path / f"{domain}.toml").write_text(order + as_toml("lidar-world", rows))
    assert list(kalman._read_folder(tmp_path)) == ["Mine-lidar-world", "Aachen-lidar-world", "Last-lidar-world"]
    task = kitti_task(motion_noise="Mine", detector="lidar", classes=("pedestrian",))
    assert stored_noise(task).measurement.tolist() == [0.03]


# make_scene: a car along x at 8 m/s, one along y at 5 m/s, a pedestrian at rest; 0.1 s a frame, 8 frames.
RULES = kitti_task(classes=("car", "pedestrian"), past=3, future=2)


def test_windows_of_the_truth() -> None:
    windows = collect([make_scene()], replace(RULES, observe="truth"), TruthTracker())
    assert len(windows.class_id) == 3 * 6  # the last two frames have no future
    assert windows.class_id.tolist() == [0, 0, 1] * 6
    # In the heading frame of the last box both cars drive along the first axis.
    for row, step in ((0, 0.8), (1, 0.5)):
        np.testing.assert_allclose(windows.future[row::3], np.tile([[step, 0], [2 * step, 0]], (6, 1, 1)), atol=1e-12)
        np.testing.assert_allclose(windows.position[6 + row, :, 0], [-2 * step, -step, 0], atol=1e-12)
    np.testing.assert_allclose(windows.future[2::3], 0, atol=1e-12)
    assert windows.valid[:9:3].tolist() == [[False, False, True], [False, True, True], [True, True, True]]


def test_windows_of_a_tracker() -> None:
    scene = make_scene(empty=(4,))
    windows = collect([scene, bare_scene()], RULES, HypothesisTracker())
    # In frame 4 all three coast; the pasts show it, the futures are the truth as ever.
    assert windows.valid[12:15].tolist() == [[True, True, False]] * 3
    # The origin is the last detection, 0.1 m ahead of the object, not the filtered box.
    np.testing.assert_allclose(windows.future[:12:3], np.tile([[0.7, 0], [1.5, 0]], (4, 1, 1)), atol=1e-12)
    assert len(collect([bare_scene()], RULES, HypothesisTracker()).class_id) == 0
    whole, parts = (collect(each, RULES, HypothesisTracker()) for each in ([end_to_end([scene] * 2, 0.2)], [scene] * 2))
    for column in fields(windows):  # nothing crosses a hole in time
        np.testing.assert_array_equal(getattr(whole, column.name), getattr(parts, column.name))
    far = replace(scene, truth=replace(scene.truth, box=scene.truth.box + 5.0))
    assert len(collect([far], RULES, HypothesisTracker()).class_id) == 0


def test_a_fit_to_scenes_leaves_out_classes_without_windows() -> None:
    rows = fit_scenes([make_scene(frames=12)], replace(RULES, classes=("car", "pedestrian", "cyclist")))
    assert (list(rows), list(rows["car"])) == (["car", "pedestrian"], [field.name for field in fields(NoiseTable)])
