"""Networks that see the detections around an object: in NumPy and in torch, in any order, whatever the track was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mtp_bench import Pipeline, SubmissionError
from mtp_bench.prediction import GreedySampler, LearnedPredictor
from mtp_bench.prediction.learned.affinity import Affinity, soft_past
from mtp_bench.prediction.learned.around import around_inputs, detections_of_tracks, fitted_velocity, nearest, shares
from mtp_bench.prediction.learned.local import Arrays
from mtp_bench.prediction.learned.network import Network, Sizes
from mtp_bench.prediction.learned.tracking_free import TrackingFree, support
from mtp_bench.prediction.learned.weights import StoredWeights, write_weights
from mtp_bench.prediction.windows import Surroundings, TrackWindows
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.training.augmentation import vary_detections
from mtp_bench.training.losses import winner_takes_all
from mtp_bench.types import Floats, Ints, starts_of
from tests.support.tracking_scenes import at_once, frame, kitti_task, observation

SIZES = Sizes(("car", "pedestrian"), past=4, future=3, modes=5, dt=0.5)
OBJECTS, SCENES = 6, 2
NETWORKS = pytest.mark.parametrize("network", [TrackingFree(), Affinity()], ids=lambda network: network.name)


def table(box: Floats, class_id: Ints, counts: Ints, before: Ints, seed: int = 0) -> Surroundings:
    """Frames of so many detections, with random scores and velocities."""
    rng = np.random.default_rng(seed)
    return Surroundings(
        starts_of(counts), box, rng.normal(size=(len(box), 2)), class_id, rng.uniform(0, 1, len(box)), before
    )


def crowd() -> tuple[TrackWindows, Ints, Surroundings]:
    """In each scene four frames of six objects 3 m apart, each detected; the windows are of the last frame of each."""
    rng, past = np.random.default_rng(1), SIZES.past
    now = np.zeros((SCENES, OBJECTS, 7))
    now[..., :2], now[..., 3] = rng.uniform(-5, 5, (SCENES, OBJECTS, 2)), rng.uniform(-3, 3, (SCENES, OBJECTS))
    now[..., 4:] = rng.uniform(1, 4, (SCENES, OBJECTS, 3))
    box = np.repeat(now[:, None], past, axis=1)  # [scenes, P, objects, 7]
    age = SIZES.dt * np.arange(past)[::-1]
    box[..., :2] -= rng.normal(0, 3, (SCENES, 1, OBJECTS, 2)) * age[:, None, None]
    class_id = np.tile(np.arange(OBJECTS) % 2, (SCENES, past, 1))
    counts = np.full(SCENES * past, OBJECTS)
    seen = table(box.reshape(-1, 7), class_id.ravel(), counts, np.tile(np.arange(past), SCENES))
    windows = windows_with(np.swapaxes(box, 1, 2).reshape(-1, past, 7), class_id[:, 0].ravel())
    return windows, np.repeat([past - 1, 2 * past - 1], OBJECTS), seen


def windows_with(box: Floats, class_id: Ints, seed: int = 2) -> TrackWindows:
    """Windows of these boxes [n, P, 7]; everything else is random."""
    rng = np.random.default_rng(seed)
    n, past = int(box.shape[0]), int(box.shape[1])
    alive = np.arange(past) >= rng.integers(0, past, (n, 1))
    return TrackWindows(
        box=box, taken=alive, alive=alive, detection=np.where(alive, 0, -1), score=rng.uniform(0, 1, (n, past)),
        velocity=rng.normal(size=(n, past, 2)), class_id=class_id, hits=rng.integers(1, 9, (n,)),
        age=rng.integers(9, 20, (n,)), mass=np.ones(n), best=np.ones(n, dtype=bool), ego=np.zeros((n, past, 4)),
    )  # fmt: skip


def weights_of(network: Network) -> Arrays:
    """Weights to start from, twice as large, so that everything that is seen matters."""
    future = np.random.default_rng(4).normal(size=(OBJECTS * SCENES, SIZES.future, 2)).astype(np.float32)
    start = network.start(network.inputs(*crowd(), SIZES), future, np.ones(future.shape[:2], dtype=bool), SIZES, 1)
    return {name: value if name.endswith((".mean", ".spread")) else 2 * value for name, value in start.items()}


def said(network: Network, windows: TrackWindows, moment: Ints, seen: Surroundings) -> Arrays:
    return network.forward(weights_of(network), network.inputs(windows, moment, seen, SIZES), SIZES)


def moved(seen: Surroundings, along_x: float) -> Surroundings:
    """The same detections, so many metres away."""
    return replace(seen, box=seen.box + np.array([along_x, 0, 0, 0, 0, 0, 0]))


def assert_same(got: Arrays, expected: Arrays) -> None:
    for name, value in expected.items():
        np.testing.assert_allclose(got[name], value, rtol=0, atol=2e-4, err_msg=name)


@NETWORKS
def test_weights_have_the_shapes_they_are_said_to_have(network: Network) -> None:
    assert {name: value.shape for name, value in weights_of(network).items()} == network.shapes(SIZES)


@NETWORKS
def test_numpy_gives_what_torch_gives(network: Network) -> None:
    inputs, weights = network.inputs(*crowd(), SIZES), weights_of(network)
    ours = network.forward(weights, inputs, SIZES)
    tensors, given = ({name: torch.from_numpy(value) for name, value in part.items()} for part in (weights, inputs))
    theirs = network.forward(tensors, given, SIZES)
    assert ours["modes"].shape == (OBJECTS * SCENES, 5, 3, 2)
    for name, value in ours.items():
        assert value.dtype == np.float32
        np.testing.assert_allclose(value, theirs[name].numpy(), rtol=1e-5, atol=1e-5, err_msg=name)


@NETWORKS
def test_the_order_of_detections_does_not_matter(network: Network) -> None:
    windows, moment, seen = crowd()
    rng = np.random.default_rng(3)
    order = np.concatenate([rng.permutation(np.arange(seen.start[t], seen.start[t + 1])) for t in range(seen.frames)])
    columns = {name: getattr(seen, name)[order] for name in ("box", "velocity", "class_id", "score")}
    assert_same(said(network, windows, moment, replace(seen, **columns)), said(network, windows, moment, seen))


@NETWORKS
def test_the_past_of_the_track_does_not_matter(network: Network) -> None:
    windows, moment, seen = crowd()
    box = windows.box.copy()
    box[:, :-1] = np.random.default_rng(5).normal(size=box[:, :-1].shape)
    other = windows_with(box, windows.class_id, seed=6)
    assert_same(said(network, other, moment, seen), said(network, windows, moment, seen))


@NETWORKS
def test_the_detections_matter(network: Network) -> None:
    windows, moment, seen = crowd()
    difference = (
        said(network, windows, moment, moved(seen, 0.5))["modes"] - said(network, windows, moment, seen)["modes"]
    )
    assert (np.abs(difference).max(axis=(1, 2, 3)) > 0.01).all()


@NETWORKS
def test_another_place_and_heading_of_the_world_change_nothing(network: Network) -> None:
    windows, moment, seen = crowd()
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])

    def turned(box: Floats) -> Floats:
        angle = box[..., 3:4] + np.arctan2(0.8, 0.6)
        return np.concatenate([box[..., :2] @ turn + [30.0, -20.0], box[..., 2:3], angle, box[..., 4:]], axis=-1)

    there = replace(seen, box=turned(seen.box), velocity=seen.velocity @ turn)
    got = said(network, replace(windows, box=turned(windows.box)), moment, there)
    assert_same(got, said(network, windows, moment, seen))


@NETWORKS
@pytest.mark.parametrize("distance", [1000.0, None], ids=["far", "none"])
def test_an_object_without_detections_around_it(network: Network, distance: float | None) -> None:
    windows, moment, seen = crowd()
    if distance is None:
        seen = table(np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros(8, dtype=int), seen.before)
    else:
        seen = moved(seen, distance)
    inputs = network.inputs(windows, moment, seen, SIZES)
    assert not inputs["near"].any()
    assert all(np.isfinite(value).all() for value in said(network, windows, moment, seen).values())


@NETWORKS
@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_gradients_are_finite(network: Network, away: float) -> None:
    windows, moment, seen = crowd()
    seen = moved(seen, away)
    inputs = network.inputs(windows, moment, seen, SIZES)
    weights = {name: torch.from_numpy(value).requires_grad_() for name, value in weights_of(network).items()}
    batch = {name: torch.from_numpy(value) for name, value in inputs.items()}
    batch |= {"future": torch.ones(12, 3, 2), "known": torch.ones(12, 3), "present": torch.zeros(12, 2)}
    batch["weight"] = torch.ones(12)
    random = torch.Generator()
    loss = winner_takes_all(network, weights, vary_detections(batch, random), SIZES, 0.1, random)
    loss.backward()  # type: ignore[no-untyped-call]
    assert all(bool(torch.isfinite(value.grad).all()) for value in weights.values() if value.grad is not None)


def test_a_scene_does_not_see_the_one_before() -> None:
    windows, moment, seen = crowd()
    assert around_inputs(windows, moment, seen, SIZES)["near"][:, :-1].any()
    assert not around_inputs(windows, np.full(12, 4), seen, SIZES)["near"][:, :-1].any()  # the first frame of its scene


def test_the_nearest_detections_are_kept_and_the_reach_grows_with_age() -> None:
    # Ten detections ahead of an object that looks along y, 1 m apart, the farthest first; one frame.
    box = np.zeros((10, 7))
    box[:, 1], box[:, 4:] = np.arange(10, 0, -1), 1
    here = np.array([0, 0, 0, np.pi / 2, 4, 2, 1.5])
    windows = windows_with(np.tile(here, (1, 4, 1)), np.array([0]))
    seen = table(box, np.zeros(10, dtype=int), np.array([10]), np.array([0]))
    rows = nearest(windows, np.array([0]), seen, 0, 0.0)
    assert rows[0].tolist() == [9, 8, -1, -1, -1, -1]  # 1 and 2 m away
    assert nearest(windows, np.array([0]), seen, 0, 1.0)[0].tolist() == [9, 8, 7, 6, 5, 4]
    others = replace(seen, class_id=np.ones(10, dtype=int))
    assert nearest(windows, np.array([0]), others, 0, 0.0)[0, :2].tolist() == [9, -1]
    seen_from = around_inputs(windows, np.array([0]), seen, SIZES)
    np.testing.assert_allclose(seen_from["position"][0, -1, :3], [[1, 0], [2, 0], [0, 0]], atol=1e-6)
    np.testing.assert_allclose(seen_from["ratio"][0, -1, 0], [np.log(1 / 4), np.log(1 / 2)], rtol=1e-6)


def test_of_a_track_alone_only_what_it_took_is_seen() -> None:
    windows, moment, seen = crowd()
    detection = np.tile(np.arange(OBJECTS)[:, None], (SCENES, SIZES.past))
    detection[2, 1] = -1  # coasts
    windows = replace(windows, detection=detection)
    alone, last = detections_of_tracks(windows, moment, seen)
    inputs = around_inputs(windows, last, alone, SIZES)
    near = inputs["near"]
    assert near[..., 0].all(axis=0).tolist() == [True, False, True, True]
    assert not near[2, 1].any()
    assert not near[..., 1:].any()
    score = seen.score.reshape(SCENES, SIZES.past, OBJECTS).swapaxes(1, 2).reshape(-1, SIZES.past)
    np.testing.assert_array_equal(inputs["score"][..., 0], (score * (detection >= 0)).astype(np.float32))
    crowded = around_inputs(windows, moment, seen, SIZES)
    np.testing.assert_array_equal(inputs["position"][:, -1, 0], crowded["position"][:, -1, 0])


def test_of_a_track_alone_frames_before_its_scene_are_empty() -> None:
    windows, _, seen = crowd()
    windows = replace(windows, detection=np.zeros((12, SIZES.past), dtype=int))
    alone, last = detections_of_tracks(windows, np.full(12, 4), seen)  # the first frame of the second scene
    assert alone.counts.reshape(12, -1).sum(axis=0).tolist() == [0, 0, 0, 12]
    assert last.tolist() == list(range(3, 48, 4))


@NETWORKS
def test_an_agent_whose_tracker_associates(network: Network, tmp_path: Path) -> None:
    """Beside a track, detections of another class that it does not take change nothing, as they do for a network."""
    task = kitti_task(k=5, samples=5)
    sizes = Sizes.of(task)
    windows, moment, seen = crowd()
    known = np.ones((12, sizes.future), dtype=bool)
    windows = replace(windows, box=np.repeat(windows.box, 3, axis=1)[:, : sizes.past])
    inputs = network.inputs(windows, moment, seen, sizes)
    weights = network.start(inputs, np.ones((12, sizes.future, 2), np.float32), known, sizes, 1)
    file = tmp_path / "weights.safetensors"
    write_weights(file, StoredWeights(weights, network.name, sizes, {"on": "tracklets"}))
    changed = []
    for association in ("network", "track"):
        told = []
        for beside in ((), ((1.0, 0.5, 1),)):
            predictor = LearnedPredictor(network.name, weights=file, association=association)
            agent = Pipeline(HypothesisTracker(1, at_once()), predictor, GreedySampler())
            agent.reset(task)
            frames = [frame((0.8 * step, 0.0, 0), *beside) for step in range(5)]
            told.append([agent.act(observation(boxes))["forecast"][0] for boxes in frames][-1])
        changed.append(not np.allclose(told[0], told[1], rtol=0, atol=1e-4))
    assert changed == [True, False]


def test_who_associates_is_checked() -> None:
    with pytest.raises(SubmissionError, match="association is 'none', expected one of: network, track"):
        LearnedPredictor("affinity", association="none")
    with pytest.raises(SubmissionError, match="'modes', which gets tracks anyway; it is for: affinity, tracking_free"):
        LearnedPredictor("modes", association="track")


def test_the_velocity_of_places_on_a_line_is_exact_but_for_the_prior() -> None:
    age = np.array([[0.5, 1.0, 1.5]])
    position = -np.array([3.0, -1.0]) * age[:, :, None]
    got = fitted_velocity(age, position, np.ones((1, 3)), np.array([[3.0, -1.0]]), 0.5)
    np.testing.assert_allclose(got, [[3, -1]])
    np.testing.assert_allclose(fitted_velocity(age, position, np.zeros((1, 3)), np.array([[7.0, 8.0]]), 0.5), [[7, 8]])
    position[0, 2] = 50.0  # of no weight
    got = fitted_velocity(age, position, np.array([[1.0, 0.5, 0.0]]), np.array([[3.0, -1.0]]), 0.5)
    np.testing.assert_allclose(got, [[3, -1]])


def test_shares_are_those_of_a_softmax_with_none() -> None:
    logit, near = np.array([[0.0, np.log(2), 99.0], [3.0, 3.0, 3.0]]), np.array([[1.0, 1, 0], [0, 0, 0]])
    np.testing.assert_allclose(shares(logit, near), np.array([[0.25, 0.5, 0], [0, 0, 0]]))


def test_support_counts_the_frames_that_agree() -> None:
    # An object at 4 m/s, seen in all frames, and something that stands elsewhere in the first one.
    position = np.zeros((1, 4, 2, 2))
    position[0, :, 0, 0] = [-6, -4, -2, 0]
    position[0, 0, 1] = [-5, 8]
    near = np.array([[[1.0, 1], [1, 0], [1, 0], [1, 0]]])
    age = np.array([1.5, 1.0, 0.5, 0.5])[None, :, None, None]
    got = support(-position / age, position, near, 0.5)[0]
    assert got[:3, 0] == pytest.approx([3, 3, 3])
    assert got[0, 1] == pytest.approx(1, abs=0.2)  # itself alone
    assert (got[3], got[1, 1]) == (pytest.approx([0, 0]), 0)


def test_before_training_the_soft_past_follows_an_object_that_is_alone() -> None:
    # A car at 4 m/s that is not detected in the second of four frames.
    box = np.zeros((3, 7))
    box[:, 0], box[:, 4:] = [-6, -2, 0], 2
    seen = table(box, np.zeros(3, dtype=int), np.array([1, 0, 1, 1]), np.arange(4))
    inputs = around_inputs(windows_with(np.tile(box[2], (1, 4, 1)), np.array([0])), np.array([3]), seen, SIZES)
    weights = {name: 0 * value if name.startswith("pair.") else value for name, value in weights_of(Affinity()).items()}
    past = soft_past(weights, inputs, SIZES)
    np.testing.assert_allclose(past["position"][0, :, 0], [-6, -4, -2, 0], atol=0.3)
    assert (past["taken"][0] > [0.6, -1, 0.6, 0.6]).all()
    assert past["taken"][0, 1] == 0


def test_varied_batches_keep_places_and_futures_together() -> None:
    inputs = TrackingFree().inputs(*crowd(), SIZES)
    batch = {name: torch.from_numpy(value) for name, value in inputs.items()}
    batch |= {"future": batch["position"][:, -1, :3].clone(), "present": batch["position"][:, -1, 0].clone()}
    got = vary_detections(batch, torch.Generator().manual_seed(1))
    there = got["near"][:, -1, :3] > 0
    torch.testing.assert_close(got["position"][:, -1, :3][there], got["future"][there])
    torch.testing.assert_close(got["position"].norm(dim=-1), batch["position"].norm(dim=-1) * got["near"])
    for name in ("position", "velocity", "yaw", "score", "same", "ratio"):
        assert not got[name][got["near"] == 0].any()
