"""Files of weights, those that ship among them, and the predictor that runs them."""

import json
import lzma
import os
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save_file

from mtp_bench import MTPEnv, Pipeline, SubmissionError, card_ids
from mtp_bench.cards import load_card
from mtp_bench.core import Ints
from mtp_bench.core.networks import PACKED_SUFFIX, SHIPPED_WEIGHTS, WEIGHTS_VARIABLE
from mtp_bench.prediction import GreedySampler, KMeansSampler, LearnedPredictor
from mtp_bench.prediction.learned.modes import Modes
from mtp_bench.prediction.learned.network import Network, Sizes, network_of
from mtp_bench.prediction.learned.predictor import (
    MOST_BYTES as MOST_WEIGHTS,
    StoredWeights,
    find_weights,
    read_weights,
    require_fit,
    write_weights,
)
from mtp_bench.prediction.windows import Arrays, Surroundings, TrackWindows, surroundings_of
from mtp_bench.tracking import HypothesisTracker
from tests.support.tracking_scenes import at_once, frame, kitti_task, observation

TASK = kitti_task(k=5, samples=5)
SIZES = Sizes.of(TASK)


def started(network: Network) -> Arrays:
    """Initial weights, from windows of a car at rest."""
    n, past = 12, SIZES.past
    box = np.tile([0.0, 0, 0, 0, 4, 1.8, 1.5], (n, past, 1)) + np.random.default_rng(1).normal(0, 0.1, (n, 1, 7))
    there, ones = np.ones((n, past), dtype=bool), np.ones(n, dtype=np.int64)
    windows = TrackWindows(
        box=box, taken=there, alive=there, detection=np.zeros((n, past), dtype=np.int64), score=there * 0.5,
        velocity=np.zeros((n, past, 2)), class_id=0 * ones, hits=ones * past, age=ones * past, mass=ones * 1.0,
        best=ones > 0, ego=np.zeros((n, past, 4)),
    )  # fmt: skip
    seen = surroundings_of([observation(frame((0.5, 0.0, 0)))] * n)
    future = np.random.default_rng(1).normal(0, 3, (n, SIZES.future, 2)).astype(np.float32)
    known = np.ones((n, SIZES.future), dtype=bool)
    return network.start(network.inputs(windows, np.arange(n), seen, SIZES), future, known, SIZES, 0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "modes-truth-test.safetensors"
    write_weights(path, StoredWeights(started(network_of("modes")), "modes", SIZES, {"present": True}))
    return path


def test_weights_come_back_in_half_precision(file: Path) -> None:
    stored = read_weights(file, network_of("modes"))
    weights = started(network_of("modes"))
    assert (stored.sizes, stored.card) == (SIZES, {"present": True})
    for name, value in weights.items():
        np.testing.assert_array_equal(stored.weights[name], value.astype(np.float16))


def rewritten(file: Path, arrays: Arrays | None = None, **changes: Any) -> Path:
    said = {"format": "mtp-bench weights 1", "network": "modes", "sizes": asdict(SIZES), "card": {}} | changes
    save_file(arrays or read_weights(file, network_of("modes")).weights, file, {"mtp_bench": json.dumps(said)})
    return file


BROKEN: dict[str, tuple[Any, str]] = {
    "another shape": ({"net.1.bias": np.zeros(7, np.float32)}, r"net.1.bias is \(7,\), expected \(256,\)"),
    "one more array": ({"net.9": np.zeros(7, np.float32)}, r"net\.9 is .*expected no such array"),
    "NaN": ({"net.0.bias": np.full(256, np.nan, np.float32)}, "not finite"),
    "no sizes": ({"sizes": {"classes": ["car"]}}, "does not state its sizes"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_files_that_do_not_fit_the_network(case: str, file: Path) -> None:
    changes, message = BROKEN[case]
    arrays = {name: value for name, value in changes.items() if isinstance(value, np.ndarray)}
    rest = {name: value for name, value in changes.items() if name not in arrays}
    before = dict(read_weights(file, network_of("modes")).weights)
    with pytest.raises(SubmissionError, match=message):
        read_weights(rewritten(file, before | arrays, **rest), network_of("modes"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"classes": ("car", "bus")}, "made for car, pedestrian, cyclist, but test has the class 'bus'"),
        ({"future": 12}, "made for future 10, but test has 12"),
        ({"dt": 0.5}, "made for dt"),
    ],
)
def test_weights_that_do_not_fit_the_task(changes: Any, message: str, file: Path) -> None:
    with pytest.raises(SubmissionError, match=message):
        LearnedPredictor(weights=file).reset(replace(TASK, **changes))


def test_a_file_that_was_written_again_is_read_again(file: Path) -> None:
    predictor = LearnedPredictor(weights=file)
    predictor.reset(TASK)
    rewritten(file, network="other")
    os.utime(file, ns=(0, 0))  # whatever the clock of the file system
    with pytest.raises(SubmissionError, match="weights of 'other'"):
        predictor.reset(TASK)


def test_where_weights_are_looked_for(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(file.parent))
    assert find_weights("modes", "truth", TASK) == file
    with pytest.raises(SubmissionError, match="mtp-bench train predictor modes --env test --on tracklets"):
        find_weights("modes", "tracklets", TASK)
    lent = file.rename(file.with_name("modes-truth-MTP-Highway-v0.safetensors"))
    assert find_weights("modes", "truth", replace(TASK, env_id="MTP-Merge-v0", weights_of="MTP-Highway-v0")) == lent


def test_classes_are_matched_by_name(file: Path) -> None:
    both = []
    for classes, number in ((TASK.classes, 1), (("pedestrian",), 0)):
        tracker = HypothesisTracker(1, at_once()[1:2] if number == 0 else at_once())
        agent = Pipeline(tracker, LearnedPredictor(weights=file), KMeansSampler())
        agent.reset(replace(TASK, classes=classes))
        seen = observation(frame((3.0, 2.0, 1)))
        both.append(agent.act({**seen, "detection_class": np.array([number])})["forecast"][0])
    np.testing.assert_array_equal(*both)


@pytest.mark.parametrize("trained_on", ["truth", "tracklets"])
def test_a_network_of_true_pasts_gets_no_scores(file: Path, trained_on: str, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize("network", ["affinity", "tracking_free"])
def test_an_agent_whose_tracker_associates(network: str, tmp_path: Path) -> None:
    """Beside a track, detections of another class that it does not take change nothing, as they do for a network."""
    file = tmp_path / "weights.safetensors"
    write_weights(file, StoredWeights(started(network_of(network)), network, SIZES, {"on": "tracklets"}))
    changed = []
    for association in ("network", "track"):
        told = []
        for beside in ((), ((1.0, 0.5, 1),)):
            predictor = LearnedPredictor(network, weights=file, association=association)
            agent = Pipeline(HypothesisTracker(1, at_once()), predictor, GreedySampler())
            agent.reset(TASK)
            frames = [frame((0.8 * step, 0.0, 0), *beside) for step in range(5)]
            told.append([agent.act(observation(boxes))["forecast"][0] for boxes in frames][-1])
        changed.append(not np.allclose(told[0], told[1], rtol=0, atol=1e-4))
    assert changed == [True, False]


FILES = sorted(SHIPPED_WEIGHTS.glob(f"*.safetensors{PACKED_SUFFIX}"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name.split(".")[0])
def test_they_are_of_simulated_traffic_of_envs(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path))
    name, on, env_id = file.name.split(".")[0].split("-", 2)
    card = read_weights(file, network_of(name)).card
    assert (card["env"].split(", ")[0].replace("-Lanes", ""), card["on"]) == (env_id, on)
    for trained_on in card["env"].split(", "):
        assert load_card(trained_on).simulated
    for served in (env_id, *(other for other in card_ids() if load_card(other).weights_of == env_id)):
        task = MTPEnv(served).task
        assert find_weights(name, on, task) == file
        require_fit(read_weights(file, network_of(name)).sizes, task, file)


def test_what_is_packed_to_ship_keeps_eight_bits_of_each_number(tmp_path: Path) -> None:
    before = read_weights(FILES[0], network_of(FILES[0].name.split("-")[0]))
    source = tmp_path / FILES[0].stem
    noise = np.random.default_rng(0)
    weights = {name: value * noise.normal(1, 0.1, value.shape) for name, value in before.weights.items()}
    write_weights(source, replace(before, weights=weights))
    packed = source.with_name("packed.xz")
    write_weights(packed, replace(before, weights=weights))
    after = read_weights(packed, network_of(before.network))
    assert packed.stat().st_size < 0.7 * source.stat().st_size
    assert after.card == before.card
    for name, value in after.weights.items():
        half = weights[name].astype(np.float16).astype(np.float64)
        assert (np.abs(value - half) <= np.maximum(2.0**-8 * np.abs(half), 2.0**-22)).all()
    write_weights(packed, before)
    assert packed.read_bytes() == FILES[0].read_bytes()  # what is rounded stays


def test_a_packed_file_cannot_fill_the_memory(tmp_path: Path) -> None:
    path = tmp_path / f"modes-truth-MTP-X-v0.safetensors{PACKED_SUFFIX}"
    path.write_bytes(lzma.compress(bytes(MOST_WEIGHTS + 2**20), preset=0))
    with pytest.raises(SubmissionError, match="expected at most"):
        read_weights(path, network_of("modes"))
