"""Properties of all networks: equal in NumPy and torch, in any order, wherever the world is."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from mtp_bench.core import Floats, Ints, rotation, starts_of
from mtp_bench.core.errors import SubmissionError
from mtp_bench.prediction.learned.affinity import AffinityNetwork, soft_past
from mtp_bench.prediction.learned.around import around_inputs, detections_of_tracks, fitted_velocity, nearest, shares
from mtp_bench.prediction.learned.layers import lstm, lstm_shapes
from mtp_bench.prediction.learned.modes import LEAST_SPREAD, spread_of
from mtp_bench.prediction.learned.network import Network, networks
from mtp_bench.prediction.learned.predictor import LearnedPredictor
from mtp_bench.prediction.learned.tracking_free import support
from mtp_bench.prediction.windows import (
    Arrays,
    Surroundings,
    TrackWindows,
    local_future,
    local_inputs,
    mean_velocity,
    shown_as_truth,
    to_absolute,
)
from mtp_bench.training.losses import LOSSES, vary_detections, vary_tracks
from mtp_bench.training.predictors import TrainingRequest, training_windows
from tests.support.random_windows import NOTHING_SEEN, SIZES, random_windows
from tests.support.tracking_scenes import kitti_task

OBJECTS, SCENES = 6, 2
NETWORKS = networks()
AROUND = [name for name, network in NETWORKS.items() if network.around]
EVERY = pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
OF_DETECTIONS = pytest.mark.parametrize("network", [NETWORKS[name] for name in AROUND], ids=AROUND)
OF_TRACKS = pytest.mark.parametrize("name", [name for name in NETWORKS if name not in AROUND])

CORNER = {  # a lane of 10 m along x, and one to its left that follows
    "lane_point": np.stack([np.arange(21)[:, None] * [2.0, 0.0], [10.0, 0.0] + np.arange(21)[:, None] * [0.0, 2.0]]),
    "lane_valid": np.array([np.arange(21) < 6, np.arange(21) < 21]),
    "lane_next": np.array([[1, -1, -1, -1], [-1, -1, -1, -1]]),
}


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
    seen = replace(seen, lanes={name: np.tile(value, (8, *[1] * value.ndim)) for name, value in CORNER.items()})
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
    """Initial weights, twice as large, so that all inputs matter."""
    future = np.random.default_rng(4).normal(size=(OBJECTS * SCENES, SIZES.future, 2)).astype(np.float32)
    start = network.start(network.inputs(*crowd(), SIZES), future, np.ones(future.shape[:2], dtype=bool), SIZES, 1)
    return {name: value if name.endswith((".mean", ".spread")) else 2 * value for name, value in start.items()}


def output(network: Network, windows: TrackWindows, moment: Ints, seen: Surroundings = NOTHING_SEEN) -> Arrays:
    return network.forward(weights_of(network), network.inputs(windows, moment, seen, SIZES), SIZES)


def moved(seen: Surroundings, along_x: float) -> Surroundings:
    return replace(seen, box=seen.box + np.array([along_x, 0, 0, 0, 0, 0, 0]))


def tensors(arrays: Arrays) -> dict[str, torch.Tensor]:
    return {name: torch.from_numpy(value) for name, value in arrays.items()}


def assert_same(got: Arrays, expected: Arrays, rows: Any = slice(None)) -> None:
    for name, value in expected.items():
        np.testing.assert_allclose(got[name], value[rows], rtol=0, atol=4e-4, err_msg=name)


@EVERY
def test_numpy_and_torch_agree(network: Network) -> None:
    inputs, weights = network.inputs(*crowd(), SIZES), weights_of(network)
    assert {name: value.shape for name, value in weights.items()} == network.shapes(SIZES)
    ours = network.forward(weights, inputs, SIZES)
    theirs = network.forward(tensors(weights), tensors(inputs), SIZES)
    assert ours.keys() == theirs.keys() >= {"modes", "log_weight", "present"}
    assert ours["modes"].shape == (OBJECTS * SCENES, 5, 3, 2)
    for name, value in ours.items():
        assert value.dtype == np.float32
        np.testing.assert_allclose(value, theirs[name].numpy(), rtol=1e-5, atol=1e-5, err_msg=name)


@EVERY
def test_the_order_of_windows_and_of_detections_does_not_matter(network: Network) -> None:
    windows, moment, seen = crowd()
    rng = np.random.default_rng(3)
    mixed = np.concatenate([rng.permutation(np.arange(seen.start[t], seen.start[t + 1])) for t in range(seen.frames)])
    columns = {name: getattr(seen, name)[mixed] for name in ("box", "velocity", "class_id", "score")}
    order = rng.permutation(len(moment))
    got = output(network, windows.select(order), moment[order], replace(seen, **columns))
    assert_same(got, output(network, windows, moment, seen), order)


@EVERY
def test_forecasts_turn_with_the_world(network: Network) -> None:
    windows, moment, seen = crowd()
    turn = rotation(np.array([0.7]))[0].T

    def placed(xy: Floats) -> Floats:
        return np.asarray(xy @ turn + [30.0, -20.0])

    def turned(box: Floats) -> Floats:
        return np.concatenate([placed(box[..., :2]), box[..., 2:3], box[..., 3:4] + 0.7, box[..., 4:]], -1)

    lanes = {**seen.lanes, "lane_point": placed(seen.lanes["lane_point"])}
    there = replace(seen, box=turned(seen.box), velocity=seen.velocity @ turn, lanes=lanes)
    away = replace(windows, box=turned(windows.box), velocity=windows.velocity @ turn)
    got, expected = output(network, away, moment, there), output(network, windows, moment, seen)
    np.testing.assert_allclose(got["modes"], expected["modes"], rtol=0, atol=2e-3)
    absolute = placed(to_absolute(windows, expected["modes"]))
    np.testing.assert_allclose(to_absolute(away, got["modes"]), absolute, rtol=0, atol=4e-3)


@EVERY
@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_gradients_are_finite(network: Network, away: float) -> None:
    windows, moment, seen = crowd()
    weights = {name: value.requires_grad_() for name, value in tensors(weights_of(network)).items()}
    batch = tensors(network.inputs(windows, moment, moved(seen, away), SIZES))
    batch |= {"future": torch.ones(12, 3, 2), "is_known": torch.ones(12, 3), "present": torch.zeros(12, 2)}
    batch["weight"] = torch.ones(12)
    random, vary = torch.Generator(), vary_detections if network.around else vary_tracks
    for stage in network.recipe.stages:
        loss = LOSSES[stage.loss](network, weights, vary(batch, random), SIZES, 0.1, random)
        loss.backward()  # type: ignore[no-untyped-call]
    assert all(bool(torch.isfinite(value.grad).all()) for value in weights.values() if value.grad is not None)


@pytest.mark.parametrize("yaw", [0.0, np.pi], ids=["ahead", "box turned round"])
def test_a_network_of_lanes_goes_round_the_corner_before_training(yaw: float) -> None:
    """At 8 m/s, half a metre left of a lane; mirrored and turned, the forecasts are too."""
    network, box = NETWORKS["modes_lanes"], np.zeros((1, SIZES.past, 7))
    box[0, :, 0], box[0, :, 1], box[..., 3], box[..., 4:] = [-8, -4, 0, 4], 0.5, yaw, 2
    lanes = {name: value[None] for name, value in CORNER.items()}
    seen, moment = replace(table(box[0, -1:], np.array([0]), np.array([1]), np.array([0])), lanes=lanes), np.array([0])
    windows = replace(windows_with(box, np.array([0])), alive=np.ones((1, SIZES.past), dtype=bool))
    inputs, weights = network.inputs(windows, moment, seen, SIZES), weights_of(network)
    weights = {name: 0 * value if name.startswith("net.") else value for name, value in weights.items()}
    modes = network.forward(weights, inputs, SIZES)["modes"]
    for mode, last in zip(to_absolute(windows, modes)[0], [[9.5, 6]] * 3 + [[16, 0.5]] * 2, strict=True):
        np.testing.assert_allclose(mode[[0, -1]], [[8, 0.5], last], atol=1e-4)
    batch = tensors(inputs) | {"future": torch.from_numpy(modes[:, 0]), "present": torch.zeros(1, 2)}
    for seed in range(9):
        varied = vary_tracks(batch, torch.Generator().manual_seed(seed))
        if varied["alive"].all():
            got = network.forward(tensors(weights), varied, SIZES)["modes"][:, 0]
            np.testing.assert_allclose(got.numpy(), varied["future"].numpy(), atol=1e-3)


def test_lanes_are_needed() -> None:
    with pytest.raises(SubmissionError, match=r"MTP-Merge-v0 shows no lanes, .* 'modes_lanes' reads"):
        LearnedPredictor("modes_lanes").reset(kitti_task(env_id="MTP-Merge-v0"))
    with pytest.raises(SubmissionError, match="MTP-Merge-v0 shows no lanes"):
        training_windows(TrainingRequest("modes_lanes", "MTP-Merge-v0"))


@OF_TRACKS
def test_frames_before_birth_do_not_matter(name: str) -> None:
    windows, moment, _ = crowd()
    other = replace(windows, box=np.where(windows.alive[:, :, None], windows.box, 1e3))
    assert_same(output(NETWORKS[name], other, moment), output(NETWORKS[name], windows, moment))


@OF_DETECTIONS
def test_detections_matter_and_the_past_of_the_track_does_not(network: Network) -> None:
    windows, moment, seen = crowd()
    box = windows.box.copy()
    box[:, :-1] = np.random.default_rng(5).normal(size=box[:, :-1].shape)
    expected = output(network, windows, moment, seen)
    assert_same(output(network, windows_with(box, windows.class_id, seed=6), moment, seen), expected)
    difference = output(network, windows, moment, moved(seen, 0.5))["modes"] - expected["modes"]
    assert (np.abs(difference).max(axis=(1, 2, 3)) > 0.01).all()


@OF_DETECTIONS
@pytest.mark.parametrize("distance", [1000.0, None], ids=["far", "none"])
def test_an_object_without_detections_around_it(network: Network, distance: float | None) -> None:
    windows, moment, seen = crowd()
    empty = table(np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros(8, dtype=int), seen.before)
    seen = empty if distance is None else moved(seen, distance)
    assert not network.inputs(windows, moment, seen, SIZES)["near"].any()
    assert all(np.isfinite(value).all() for value in output(network, windows, moment, seen).values())


def test_many_frames_at_once_are_each_frame_alone() -> None:
    network, (windows, moment) = NETWORKS["ptp"], random_windows()
    parts = [output(network, windows.select(moment == t), moment[moment == t])["modes"] for t in range(3)]
    np.testing.assert_allclose(output(network, windows, moment)["modes"], np.concatenate(parts), rtol=0, atol=1e-4)


@pytest.mark.parametrize("change", ["nearer", "absent", "far", "another hypothesis", "the same object"])
def test_which_objects_a_window_sees(change: str) -> None:
    network, (windows, moment) = NETWORKS["ptp"], random_windows([2], seed=5)
    box, best = windows.box.copy(), windows.best.copy()
    offset = {"the same object": 0.0, "far": 1000.0}.get(change, 1.5)
    box[1, :, :2] += box[0, -1, :2] - box[1, -1, :2] + offset
    best[1] = change != "another hypothesis"
    rows = slice(0, 1) if change == "absent" else slice(0, 2)
    got = output(network, replace(windows, box=box, best=best).select(rows), moment[rows])["modes"][0]
    alone = output(network, windows.select(slice(0, 1)), moment[:1])["modes"][0]
    assert np.allclose(got, alone, rtol=0, atol=1e-4) == (change != "nearer")


def test_there_and_back() -> None:
    windows, _ = random_windows()
    xy = np.random.default_rng(3).normal(0, 40, (10, 10, 2))
    np.testing.assert_allclose(to_absolute(windows, local_future(windows, xy)), xy, atol=1e-4)


def test_the_mean_velocity_is_a_straight_line_through_the_past() -> None:
    windows, _ = random_windows(seed=5)
    found = mean_velocity(local_inputs(windows), 0.1)
    for row in range(len(windows)):
        alive = windows.alive[row]
        position = local_inputs(windows)["position"][row][alive]
        if alive.sum() > 1:
            slope = np.polyfit(0.1 * np.arange(alive.sum()), position, 1)[0]
            np.testing.assert_allclose(found[row], slope, atol=1e-3)
        else:
            np.testing.assert_allclose(found[row], local_inputs(windows)["velocity"][row, -1])


def test_an_lstm_is_that_of_torch_and_skips_what_is_masked() -> None:
    rng = np.random.default_rng(0)
    weights = {name: rng.normal(size=shape).astype(np.float32) for name, shape in lstm_shapes("a", 3, 4).items()}
    twin: Any = torch.nn.LSTM(3, 4, batch_first=True)
    with torch.no_grad():
        twin.weight_ih_l0.copy_(torch.from_numpy(weights["a.weight"][:3].T.copy()))
        twin.weight_hh_l0.copy_(torch.from_numpy(weights["a.weight"][3:].T.copy()))
        twin.bias_ih_l0.copy_(torch.from_numpy(weights["a.bias"]))
        twin.bias_hh_l0.zero_()
    steps = rng.normal(size=(5, 6, 3)).astype(np.float32)
    hidden = lstm(weights, "a", steps, np.ones((5, 6), np.float32))
    np.testing.assert_allclose(hidden, twin(torch.from_numpy(steps))[1][0][0].detach().numpy(), atol=1e-5)
    late = np.ones((5, 6), np.float32)
    late[:, :2] = 0
    np.testing.assert_allclose(
        lstm(weights, "a", steps, late), lstm(weights, "a", steps[:, 2:], late[:, 2:]), atol=1e-6
    )


def test_steps_that_no_window_knows_have_the_least_spread() -> None:
    value, known = np.full((3, 2), 2.0), np.array([[True, False]] * 3)
    assert spread_of(value, known).tolist() == [[2.0], [np.float32(LEAST_SPREAD)]]


def test_true_pasts_are_shown_as_they_are() -> None:
    windows, _ = random_windows()
    true = replace(windows, score=windows.taken * 1.0)
    shown = shown_as_truth(windows)
    for name, expected in local_inputs(true).items():
        np.testing.assert_array_equal(local_inputs(shown)[name], expected, err_msg=name)
    older = replace(windows, hits=windows.hits + 5, age=windows.age + 9)
    np.testing.assert_array_equal(shown_as_truth(older).hits, windows.hits)
    np.testing.assert_array_equal(shown_as_truth(older).age, windows.age)


def test_a_scene_does_not_see_the_one_before() -> None:
    windows, moment, seen = crowd()
    assert around_inputs(windows, moment, seen, SIZES)["near"][:, :-1].any()
    assert not around_inputs(windows, np.full(12, 4), seen, SIZES)["near"][:, :-1].any()  # the first frame of its scene


def test_the_nearest_detections_are_kept_and_the_reach_grows_with_age() -> None:
    # Ten detections ahead of an object that looks along y, 1 m apart, the farthest first; one frame.
    box = np.zeros((10, 7))
    box[:, 1], box[:, 4:] = np.arange(10, 0, -1), 1
    windows = windows_with(np.tile(np.array([0, 0, 0, np.pi / 2, 4, 2, 1.5]), (1, 4, 1)), np.array([0]))
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
    got = support(-position / np.array([1.5, 1.0, 0.5, 0.5])[None, :, None, None], position, near, 0.5)[0]
    assert got[:3, 0] == pytest.approx([3, 3, 3])
    assert got[0, 1] == pytest.approx(1, abs=0.2)  # itself alone
    assert (got[3], got[1, 1]) == (pytest.approx([0, 0]), 0)


def test_before_training_the_soft_past_follows_an_object_that_is_alone() -> None:
    # A car at 4 m/s that is not detected in the second of four frames.
    box = np.zeros((3, 7))
    box[:, 0], box[:, 4:] = [-6, -2, 0], 2
    seen = table(box, np.zeros(3, dtype=int), np.array([1, 0, 1, 1]), np.arange(4))
    inputs = around_inputs(windows_with(np.tile(box[2], (1, 4, 1)), np.array([0])), np.array([3]), seen, SIZES)
    weights = {
        name: 0 * value if name.startswith("pair.") else value for name, value in weights_of(AffinityNetwork()).items()
    }
    past = soft_past(weights, inputs, SIZES)
    np.testing.assert_allclose(past["position"][0, :, 0], [-6, -4, -2, 0], atol=0.3)
    assert (past["taken"][0] > [0.6, -1, 0.6, 0.6]).all()
    assert past["taken"][0, 1] == 0
