"""Networks: one function for NumPy and torch, files of weights that are checked, and agents that run them."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from mtp_bench import Pipeline, SubmissionError
from mtp_bench.networks import VARIABLE
from mtp_bench.prediction import KMeansSampler, LearnedPredictor
from mtp_bench.prediction.learned.layers import lstm, lstm_shapes
from mtp_bench.prediction.learned.local import Arrays, local_future, local_inputs, mean_velocity, to_absolute
from mtp_bench.prediction.learned.modes import LEAST_SPREAD, Modes, spread_of
from mtp_bench.prediction.learned.network import Network, Sizes
from mtp_bench.prediction.learned.registry import NETWORKS, network_of
from mtp_bench.prediction.learned.weights import (
    FORMAT,
    StoredWeights,
    find_weights,
    read_weights,
    require_fit,
    write_weights,
)
from mtp_bench.prediction.windows import Surroundings, TrackWindows, shown_as_truth, surroundings_of
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.types import Ints
from tests.support.tracking_scenes import at_once, frame, kitti_task, observation

ALONE = [name for name in NETWORKS if name not in ("affinity", "tracking_free")]  # of others `started` shows nothing
TASK = kitti_task(k=5, samples=5)
SIZES = Sizes.of(TASK)


def random_windows(n: int = 12, seed: int = 0) -> TrackWindows:
    """Windows of objects on the move, of all ages, in all directions."""
    rng = np.random.default_rng(seed)
    speed, start, length = rng.normal(0, 8, (n, 1, 2)), rng.normal(0, 30, (n, 1, 2)), rng.integers(1, 11, n)
    box = np.zeros((n, 10, 7))
    box[:, :, :2] = start + 0.1 * speed * np.arange(10)[:, None] + rng.normal(0, 0.1, (n, 10, 2))
    box[:, :, 3] = np.arctan2(speed[..., 1], speed[..., 0])
    box[:, :, 4:] = [4.0, 1.8, 1.5]
    alive = np.arange(10) >= 10 - length[:, None]
    taken = alive & ((rng.random((n, 10)) < 0.8) | (np.arange(10) == 10 - length[:, None]))
    return TrackWindows(
        box=box * alive[:, :, None], taken=taken, alive=alive, detection=np.where(taken, 0, -1),
        score=rng.normal(0, 2, (n, 10)) * taken, velocity=rng.normal(0, 3, (n, 10, 2)) * taken[:, :, None],
        class_id=rng.integers(0, 3, n), hits=taken.sum(axis=1), age=length, mass=rng.random(n),
        best=rng.random(n) < 0.5, ego=np.zeros((n, 10, 4)),
    )  # fmt: skip


def started(network: Network, windows: TrackWindows) -> tuple[Arrays, Arrays]:
    """Weights to start from and inputs of windows, each alone in its frame."""
    empty = {f"detection_{name}": np.zeros((0, *shape)) for name, shape in _DETECTION.items()}
    seen = surroundings_of([{**empty, "detection_valid": np.zeros(0)}] * len(windows))
    inputs = network.inputs(windows, np.arange(len(windows)), seen, SIZES)
    rng = np.random.default_rng(1)
    future = rng.normal(0, 3, (len(windows), 10, 2)).astype(np.float32)
    return network.start(inputs, future, np.ones(future.shape[:2], dtype=bool), SIZES, 0), inputs


_DETECTION = {"box": (7,), "velocity": (2,), "class": (), "score": ()}


@pytest.mark.parametrize("name", NETWORKS)
def test_numpy_and_torch_agree(name: str) -> None:
    network = network_of(name)
    weights, inputs = started(network, random_windows())
    assert {key: value.shape for key, value in weights.items()} == network.shapes(SIZES)
    plain = network.forward(weights, inputs, SIZES)
    tensors = {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in inputs.items()}
    twin = network.forward({key: torch.from_numpy(value) for key, value in weights.items()}, tensors, SIZES)
    assert plain.keys() == twin.keys()
    for key, value in plain.items():
        assert value.dtype == np.float32
        np.testing.assert_allclose(value, twin[key].numpy(), rtol=1e-5, atol=1e-5)
    assert plain["modes"].shape == (12, 5, 10, 2)
    assert plain["log_weight"].shape == (12, 5)


@pytest.mark.parametrize("name", ALONE)
def test_what_was_before_birth_is_not_seen(name: str) -> None:
    network, windows = network_of(name), random_windows()
    weights, inputs = started(network, windows)
    said = network.forward(weights, inputs, SIZES)
    dirty = replace(windows, box=np.where(windows.alive[:, :, None], windows.box, 1e3))
    again = network.forward(weights, started(network, dirty)[1], SIZES)
    for key, value in said.items():
        np.testing.assert_allclose(value, again[key], atol=1e-5)


@pytest.mark.parametrize("name", ALONE)
def test_forecasts_turn_with_the_world(name: str) -> None:
    network, windows = network_of(name), random_windows()
    weights, inputs = started(network, windows)
    said = to_absolute(windows, network.forward(weights, inputs, SIZES)["modes"])
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, s], [-s, c]])
    box = windows.box.copy()
    box[:, :, :2] = np.where(windows.alive[:, :, None], box[:, :, :2] @ turn + [5.0, -9.0], 0.0)
    box[:, :, 3] += 0.7
    turned = replace(windows, box=box, velocity=windows.velocity @ turn)
    again = to_absolute(turned, network.forward(weights, started(network, turned)[1], SIZES)["modes"])
    np.testing.assert_allclose(again, said @ turn + [5.0, -9.0], atol=1e-3)


def test_there_and_back() -> None:
    windows = random_windows()
    xy = np.random.default_rng(3).normal(0, 40, (12, 10, 2))
    np.testing.assert_allclose(to_absolute(windows, local_future(windows, xy)), xy, atol=1e-4)


def test_the_mean_velocity_is_a_straight_line_through_the_past() -> None:
    windows = random_windows(seed=5)
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


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "modes-truth-test.safetensors"
    weights, _ = started(network_of("modes"), random_windows())
    write_weights(path, StoredWeights(weights, "modes", SIZES, {"present": True}))
    return path


def test_weights_come_back_in_half_precision(file: Path) -> None:
    stored = read_weights(file, network_of("modes"))
    weights, _ = started(network_of("modes"), random_windows())
    assert stored.sizes == SIZES
    assert stored.card == {"present": True}
    for name, value in weights.items():
        np.testing.assert_array_equal(stored.weights[name], value.astype(np.float16))


def rewritten(file: Path, arrays: Arrays | None = None, **changes: Any) -> Path:
    said = {"format": FORMAT, "network": "modes", "sizes": asdict(SIZES), "card": {}} | changes
    save_file(arrays or read_weights(file, network_of("modes")).weights, file, {"mtp_bench": json.dumps(said)})
    return file


def test_files_that_do_not_fit_are_refused(file: Path) -> None:
    modes = network_of("modes")
    with pytest.raises(SubmissionError, match=r"made for car, pedestrian, cyclist, but test has the class 'bus'"):
        require_fit(read_weights(file, modes).sizes, replace(TASK, classes=("car", "bus")), file)
    with pytest.raises(SubmissionError, match="made for future 10, but test has 12"):
        require_fit(read_weights(file, modes).sizes, replace(TASK, future=12), file)
    arrays = dict(read_weights(file, modes).weights)
    with pytest.raises(SubmissionError, match=r"net.1.bias is \(7,\), expected \(256,\)"):
        read_weights(rewritten(file, {**arrays, "net.1.bias": np.zeros(7, np.float32)}), modes)
    with pytest.raises(SubmissionError, match=r"net\.9 is .*expected no such array"):
        read_weights(rewritten(file, {**arrays, "net.9": np.zeros(7, np.float32)}), modes)
    with pytest.raises(SubmissionError, match=r"not finite"):
        read_weights(rewritten(file, {**arrays, "net.0.bias": np.full(256, np.nan, np.float32)}), modes)
    with pytest.raises(SubmissionError, match="weights of 'other', expected 'modes'"):
        read_weights(rewritten(file, arrays, network="other"), modes)
    with pytest.raises(SubmissionError, match="does not state its sizes"):
        read_weights(rewritten(file, arrays, sizes={"classes": ["car"]}), modes)
    with pytest.raises(SubmissionError, match="its card is list, expected a table"):
        read_weights(rewritten(file, arrays, card=[]), modes)
    file.write_bytes(b"\x80\x04\x95 a pickle")
    with pytest.raises(SubmissionError, match="not a file of weights"):
        read_weights(file, modes)
    with pytest.raises(SubmissionError, match="not a file of weights"):
        read_weights(file.with_name("missing"), modes)


def test_where_weights_are_looked_for(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(file.parent))
    assert find_weights("modes", "truth", TASK) == file
    with pytest.raises(SubmissionError, match="mtp-bench train predictor modes --env test --on tracklets"):
        find_weights("modes", "tracklets", TASK)
    lent = file.rename(file.with_name("modes-truth-MTP-Highway-v0.safetensors"))
    assert find_weights("modes", "truth", replace(TASK, env_id="MTP-Merge-v0", weights_of="MTP-Highway-v0")) == lent


def test_an_agent_runs_the_network_of_its_task(file: Path) -> None:
    agent = Pipeline(HypothesisTracker(4, at_once()), LearnedPredictor("modes", weights=file), KMeansSampler())
    agent.reset(TASK)
    frames = [frame((0.8 * step, 0.0, 0), (5.0, 9.0, 1), (30.0, 0.4 * step, 2)) for step in range(12)]
    told = [agent.act(observation(seen)) for seen in frames][-1]
    there = told["object_valid"] > 0
    assert there.sum() == 3
    assert np.isfinite(told["forecast"][there]).all()
    np.testing.assert_allclose(np.exp(told["forecast_log_weight"][there]).sum(axis=1), 1.0, atol=1e-5)
    other = LearnedPredictor("modes", weights=file)
    with pytest.raises(SubmissionError, match="made for dt"):
        other.reset(replace(TASK, dt=0.5))


def test_classes_are_matched_by_name(file: Path) -> None:
    both = []
    for classes, number in ((TASK.classes, 1), (("pedestrian",), 0)):
        agent = Pipeline(
            HypothesisTracker(1, at_once()[1:2] if number == 0 else at_once()),
            LearnedPredictor(weights=file),
            KMeansSampler(),
        )
        agent.reset(replace(TASK, classes=classes))
        seen = observation(frame((3.0, 2.0, 1)))
        both.append(agent.act({**seen, "detection_class": np.array([number])})["forecast"][0])
    np.testing.assert_array_equal(*both)


@pytest.mark.parametrize("trained_on", ["truth", "tracklets"])
def test_a_network_that_learnt_on_true_pasts_gets_no_scores(
    file: Path, trained_on: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither of tracks nor of the detections around them."""
    rewritten(file, card={"on": trained_on})
    shown: list[float] = []
    inputs = Modes.inputs

    def watched(self: Modes, windows: TrackWindows, now: Ints, seen: Surroundings, sizes: Sizes) -> Arrays:
        shown.extend([*seen.score[-1:], *windows.score[:, -1]])
        return inputs(self, windows, now, seen, sizes)

    monkeypatch.setattr(Modes, "inputs", watched)
    agent = Pipeline(HypothesisTracker(1, at_once()), LearnedPredictor(weights=file), KMeansSampler())
    agent.reset(TASK)
    for step in range(3):
        agent.act({**observation(frame((0.8 * step, 0.0, 0))), "detection_score": np.array([7.5])})
    assert shown == [1.0 if trained_on == "truth" else 7.5] * 6


def test_steps_that_no_window_knows_have_the_least_spread() -> None:
    value, known = np.full((3, 2), 2.0), np.array([[True, False]] * 3)
    assert spread_of(value, known).tolist() == [[2.0], [np.float32(LEAST_SPREAD)]]


def test_true_pasts_are_shown_as_they_are() -> None:
    windows = random_windows()
    true = replace(windows, score=windows.taken * 1.0)
    shown = shown_as_truth(windows)
    for name, expected in local_inputs(true).items():
        np.testing.assert_array_equal(local_inputs(shown)[name], expected, err_msg=name)
    older = replace(windows, hits=windows.hits + 5, age=windows.age + 9)
    np.testing.assert_array_equal(shown_as_truth(older).hits, windows.hits)
    np.testing.assert_array_equal(shown_as_truth(older).age, windows.age)
