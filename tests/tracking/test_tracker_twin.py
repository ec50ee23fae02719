"""The compiled tracker against the one in plain NumPy."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.core import Floats, Ints
from mtp_bench.core.geometry import wrap_angle
from mtp_bench.core.tracks import Tracks
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracking.kernels.motion_kernels import update_pairs, wrap
from tests.support import plain_tracker as textbook
from tests.support.plain_tracker import PlainTracker
from tests.support.tracking_scenes import kitti_task, observation, random_frames, run

FIELDS = ("track_id", "class_id", "detection", "past_valid", "member", "box", "score", "past", "log_weight")


def assert_same(ours: Tracks, plain: Tracks) -> None:
    for name in FIELDS:
        np.testing.assert_allclose(getattr(ours, name), getattr(plain, name), rtol=0, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(("hypotheses", "greedy"), [(1, False), (3, False), (20, False), (1, True)])
@pytest.mark.parametrize("seed", range(2))
def test_compiled_and_plain_tracker_agree(seed: int, hypotheses: int, greedy: bool) -> None:
    frames = random_frames(np.random.default_rng(seed), 30, objects=6, area=9.0)
    ours = HypothesisTracker(hypotheses, assignment="as_parameters" if greedy else "hungarian")
    pair = run(ours, frames), run(PlainTracker(hypotheses, greedy=greedy), frames)
    for tracks, plain in zip(*pair, strict=True):
        assert_same(tracks, plain)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("assignment", ["hungarian", "as_parameters"])
def test_they_agree_where_detections_have_the_ids_of_true_objects(assignment: str, share: float) -> None:
    """The ids know neither place nor class; without any, the tracks are those of STP bit for bit."""
    rng, task = np.random.default_rng(5), kitti_task(observe="associated")
    ours, stp = (HypothesisTracker(assignment=assignment) for _ in range(2))
    plain = PlainTracker(greedy=assignment != "hungarian")
    for tracker, known in ((ours, task), (plain, task), (stp, kitti_task())):
        tracker.reset(known)
    for detections in random_frames(rng, 60):
        seen = observation(detections)
        count = len(detections[0])
        given = np.where(rng.random(count) < share, rng.permutation(max(count, 9))[:count], -1)
        tracks, without = ours.step({**seen, "detection_id": given}), stp.step(seen)
        assert_same(tracks, plain.step({**seen, "detection_id": given}))
        if share == 0.0:
            for name in (f.name for f in fields(Tracks) if f.name != "affinity"):
                np.testing.assert_array_equal(getattr(tracks, name), getattr(without, name))


@pytest.mark.parametrize("hypotheses", [1, 8])
def test_they_agree_with_measured_velocities(hypotheses: int) -> None:
    rng, task = np.random.default_rng(7), kitti_task(velocity=True, dt=0.5)
    ours, plain = HypothesisTracker(hypotheses), PlainTracker(hypotheses)
    ours.reset(task)
    plain.reset(task)
    for detections in random_frames(rng, 25, objects=6, area=9.0):
        seen = observation(detections)
        velocity = rng.normal(0, 3, (len(detections[0]), 2))
        velocity[rng.random(len(velocity)) < 0.3] = 0.0  # not measured
        seen["detection_velocity"] = velocity
        assert_same(ours.step(seen), plain.step(seen))


@pytest.mark.data
@pytest.mark.parametrize(
    ("env_id", "scene", "frames"),
    [("MTP-KITTI-noego-v0", "0013", 60), ("MTP-nuScenes-mini-v0", "scene-0103", 12), ("MTP-PETS-v0", None, 30)],
)
def test_they_agree_on_recordings(env_id: str, scene: str | None, frames: int, data_root: Path) -> None:
    env = MTPEnv(env_id, data=str(data_root))
    observation, _ = env.reset(options={"scene": scene or env.scene_names[0]})
    action = {name: np.zeros(space.shape, space.dtype) for name, space in env.action_space.items()}  # type: ignore[attr-defined]
    ours, plain = HypothesisTracker(6), PlainTracker(6)
    ours.reset(env.task)
    plain.reset(env.task)
    for _ in range(frames):
        assert_same(ours.step(observation), plain.step(observation))
        observation = env.step(action)[0]


# ---- the motion filter of both
def unpacked(row: Floats) -> textbook.State:
    """Mean and full covariance of a state [15]."""
    covariance = np.diag(np.append([row[10]] * 3, [row[14]] * 4 + [row[13]] * 3))
    covariance[range(3), range(7, 10)], covariance[range(7, 10), range(3)] = row[11], row[12]
    return row[:10], covariance


def taken(state: Floats, leaf: Ints, detection: Ints, box: Floats, velocity: Floats, dt: float) -> Floats:
    """States that the kernel writes for pairs; its output array is longer than needed."""
    out, measured = np.full((len(leaf) + 2, 15), np.nan), np.empty((len(leaf), 7))
    update_pairs(state, leaf, detection, box, velocity, dt, out, measured)
    assert np.array_equal(measured, np.where(detection[:, None] >= 0, box[detection], out[: len(leaf), :7]))
    assert np.isnan(out[len(leaf) :]).all()
    return out[: len(leaf)]


def test_angles_are_wrapped_alike() -> None:
    rng = np.random.default_rng(0)
    edges = [0.0, -0.0, np.nextafter(-np.pi, -9), np.nextafter(np.pi, 9), 1e-300, -1e-17, 1e17]
    angle = np.concatenate([rng.uniform(-20, 20, 3000), rng.normal(0, 1e6, 1000), edges, np.arange(-9, 9) * np.pi / 2])
    wrapped = np.array([wrap(a) for a in angle])
    np.testing.assert_array_equal(wrapped, wrap_angle(angle))
    np.testing.assert_array_equal(np.signbit(wrapped), np.signbit(wrap_angle(angle)))
    assert np.isnan(wrap(np.nan))


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2, 1.6, 3.0, np.pi, -np.pi, -1.58, 6.0])
def test_detections_that_face_the_other_way(turn: float) -> None:
    one, none = np.zeros(1, dtype=np.int64), np.zeros((0, 2))
    state = taken(np.zeros((0, 15)), one - 1, one, np.array([[0, 0, 0, 0.3, 4, 2, 1.5]]), none, 0.1)
    box = np.array([[0.5, 0, 0, 0.3 + turn, 4, 2, 1.5]])
    expected = textbook.updated(unpacked(state[0]), box[0], np.zeros(2), 1)
    for value, other in zip(unpacked(taken(state, one, one, box, none, 0.1)[0]), expected, strict=True):
        np.testing.assert_allclose(value, other, rtol=1e-9, atol=1e-9)
