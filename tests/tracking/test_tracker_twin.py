"""The compiled tracker against the one in plain NumPy, and the options that only the compiled one has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.env import MTPEnv
from mtp_bench.tracking import ClassParameters, HypothesisTracker
from mtp_bench.tracking.joint import joint_k_best, per_cluster
from mtp_bench.tracks import Tracks
from tests.support.plain_tracker import PlainTracker
from tests.support.tracking_scenes import CAR, frame, kitti_task, observation, random_frames, run

FIELDS = ("track_id", "class_id", "detection", "past_valid", "member", "box", "score", "past", "log_weight")


def assert_same(ours: Tracks, plain: Tracks) -> None:
    for name in FIELDS:
        np.testing.assert_allclose(getattr(ours, name), getattr(plain, name), rtol=0, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("hypotheses", [1, 3, 20])
@pytest.mark.parametrize("seed", range(4))
def test_compiled_and_plain_tracker_agree(seed: int, hypotheses: int) -> None:
    frames = random_frames(np.random.default_rng(seed), 30, objects=6, area=9.0)
    pair = run(HypothesisTracker(hypotheses), frames), run(PlainTracker(hypotheses), frames)
    for ours, plain in zip(*pair, strict=True):
        assert_same(ours, plain)


@pytest.mark.parametrize("seed", range(6))
def test_greedy_assignment_agrees_too(seed: int) -> None:
    frames = random_frames(np.random.default_rng(seed), 40)
    pair = run(HypothesisTracker(assignment="as_parameters"), frames), run(PlainTracker(greedy=True), frames)
    for ours, plain in zip(*pair, strict=True):
        assert_same(ours, plain)


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
    [("MTP-KITTI-noego-v0", "0013", 120), ("MTP-nuScenes-mini-v0", "scene-0103", 12), ("MTP-PETS-v0", None, 60)],
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


def two_pairs(gap: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two tracks and two detections, far from two others: CSR of two ambiguous clusters of two rows each."""
    column = np.array([0, 1, 0, 1, 2, 3, 2, 3])
    cost = np.array([-3.0, -2.0, -2.0, -3.0, -3.0, -3.0 + gap, -3.0 + gap, -3.0])
    return np.arange(0, 9, 2), column, cost


def test_every_cluster_gets_its_alternatives_at_once() -> None:
    problem = (*two_pairs(0.25), 4, np.ones((1, 4), dtype=bool), np.zeros(1))
    costs, column, parent = per_cluster(*problem, k=2)
    best = joint_k_best(*problem, 2)
    np.testing.assert_array_equal(column[0], best[1][0])
    assert costs[0] == pytest.approx(best[0][0])
    assert (column[1] != column[0]).all(), "the second hypothesis takes the second choice of both clusters"
    assert (best[1][1] != best[1][0]).sum() == 2, "the second of all changes one cluster only"
    assert costs[1] == pytest.approx(-12.0 + 2.0 + 0.5)
    assert parent.tolist() == [0, 0]


def test_without_a_cluster_there_is_one_child_per_parent() -> None:
    none = np.zeros(0, dtype=np.int64)
    member, base = np.array([[True, False], [True, True]]), np.array([1.0, 0.5])
    costs, column, parent = per_cluster(np.zeros(3, dtype=np.int64), none, np.zeros(0), 2, member, base, 5)
    assert (costs.tolist(), parent.tolist(), column.tolist()) == ([0.5, 1.0], [1, 0], [[-1, -1], [-1, -1]])


def histories(tracker: HypothesisTracker, frames: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Distinct pasts per identity, mean over frames."""
    counts = []
    for tracks in run(tracker, frames):
        pasts = {(int(i), past.tobytes()) for i, past in zip(tracks.track_id, tracks.past, strict=True)}
        counts.append(len(pasts) / max(len(np.unique(tracks.track_id)), 1))
    return float(np.mean(counts))


def test_clusters_keep_more_histories() -> None:
    """Six pairs of cars that drive side by side, 30 m apart from each other: every pair may have been swapped."""
    rng = np.random.default_rng(2)
    frames = []
    for t in range(15):
        y = [30.0 * pair + side + rng.normal(0, 0.3) for pair in range(6) for side in (0.0, 1.5)]
        frames.append(frame(*((1.0 * t, value, CAR) for value in y)))
    near = (ClassParameters("hungarian", "center_distance", 4.0, 1, 3),) * 3
    joint, clusters = (histories(HypothesisTracker(6, near, per_cluster=on), frames) for on in (False, True))
    assert clusters > joint + 0.1


def test_one_hypothesis_needs_no_clusters() -> None:
    frames = random_frames(np.random.default_rng(3), 20)
    for ours, plain in zip(*(run(HypothesisTracker(1, per_cluster=on), frames) for on in (False, True)), strict=True):
        assert_same(ours, plain)
