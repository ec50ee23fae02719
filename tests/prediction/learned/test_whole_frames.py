"""Networks that look at all objects of a frame: in NumPy and in torch, in any order, alone, and frame by frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from mtp_bench.geometry import wrap_angle
from mtp_bench.prediction.kalman import rotation
from mtp_bench.prediction.learned.local import Arrays
from mtp_bench.prediction.learned.network import Network
from mtp_bench.prediction.learned.ptp import Ptp
from mtp_bench.prediction.learned.social_lstm import SocialLstm, points
from mtp_bench.prediction.windows import TrackWindows
from mtp_bench.types import Ints
from tests.support.random_windows import NOTHING_SEEN, SIZES, random_training_set, random_windows

NETWORKS = pytest.mark.parametrize("network", [Ptp(), SocialLstm()], ids=lambda network: network.name)


def weights_of(network: Network) -> Arrays:
    """Weights to start from, three times as large, so that everything that is seen matters."""
    data = random_training_set(network)
    start = network.start(data.inputs, data.future, data.known, SIZES, 1)
    return {name: value if name.endswith((".mean", ".spread")) else 3 * value for name, value in start.items()}


def tensors(arrays: Arrays) -> dict[str, torch.Tensor]:
    return {name: torch.from_numpy(value) for name, value in arrays.items()}


def said(network: Network, windows: TrackWindows, moment: Ints) -> Arrays:
    return network.forward(weights_of(network), network.inputs(windows, moment, NOTHING_SEEN, SIZES), SIZES)


@NETWORKS
def test_weights_have_the_shapes_they_are_said_to_have(network: Network) -> None:
    assert {name: value.shape for name, value in weights_of(network).items()} == network.shapes(SIZES)


@NETWORKS
def test_numpy_gives_what_torch_gives(network: Network) -> None:
    windows, moment = random_windows()
    inputs, weights = network.inputs(windows, moment, NOTHING_SEEN, SIZES), weights_of(network)
    ours = network.forward(weights, inputs, SIZES)
    theirs = network.forward(tensors(weights), tensors(inputs), SIZES)
    assert ours["modes"].shape == (10, 5, 3, 2)
    assert ours.keys() >= {"modes", "log_weight", "present"}
    for name, value in ours.items():
        assert value.dtype == np.float32
        np.testing.assert_allclose(value, theirs[name].numpy(), rtol=1e-5, atol=1e-5, err_msg=name)


@NETWORKS
def test_the_order_of_windows_does_not_matter(network: Network) -> None:
    windows, moment = random_windows()
    order = np.random.default_rng(3).permutation(len(moment))
    mixed = said(network, windows.select(order), moment[order])
    np.testing.assert_allclose(mixed["modes"], said(network, windows, moment)["modes"][order], rtol=0, atol=1e-4)


@NETWORKS
def test_many_frames_at_once_are_each_frame_by_itself(network: Network) -> None:
    windows, moment = random_windows()
    whole = said(network, windows, moment)["modes"]
    parts = [said(network, windows.select(moment == t), moment[moment == t])["modes"] for t in range(3)]
    np.testing.assert_allclose(whole, np.concatenate(parts), rtol=0, atol=1e-4)


@NETWORKS
def test_an_object_alone_is_like_one_whose_neighbours_are_far_away(network: Network) -> None:
    windows, moment = random_windows([1, 2])
    alone = said(network, windows.select(slice(0, 1)), moment[:1])["modes"]
    assert np.isfinite(alone).all()
    box = windows.box.copy()
    box[1:, :, :2] += 1000.0
    far = said(network, replace(windows, box=box), np.zeros_like(moment))["modes"]
    np.testing.assert_allclose(far[:1], alone, rtol=0, atol=1e-4)


@NETWORKS
@pytest.mark.parametrize("change", ["nearer", "absent", "another hypothesis", "the same object"])
def test_who_is_seen(network: Network, change: str) -> None:
    windows, moment = random_windows([2], seed=5)
    box, best = windows.box.copy(), windows.best.copy()
    box[1, :, :2] += box[0, -1, :2] - box[1, -1, :2] + (0 if change == "the same object" else 1.5)
    best[1] = change != "another hypothesis"
    rows = slice(0, 1) if change == "absent" else slice(0, 2)
    changed = replace(windows, box=box, best=best).select(rows)
    found = said(network, changed, moment[rows])["modes"][0]
    alone = said(network, windows.select(slice(0, 1)), moment[:1])["modes"][0]
    assert np.allclose(found, alone, rtol=0, atol=1e-5) == (change != "nearer")


@NETWORKS
def test_turning_the_world_changes_nothing(network: Network) -> None:
    windows, moment = random_windows()
    turn = rotation(np.array([0.7]))[0]
    box = windows.box.copy()
    box[:, :, :2] = box[:, :, :2] @ turn.T + np.where(windows.alive[:, :, None], [30.0, -20.0], 0.0)
    box[:, :, 3] = wrap_angle(box[:, :, 3] + 0.7) * windows.alive
    turned = replace(windows, box=box, velocity=windows.velocity @ turn.T)
    expected = said(network, windows, moment)["modes"]
    np.testing.assert_allclose(said(network, turned, moment)["modes"], expected, rtol=0, atol=2e-3)


def test_one_future_of_social_lstm_is_the_mean() -> None:
    windows, moment = random_windows()
    network, sizes = SocialLstm(), replace(SIZES, modes=1)
    out = network.forward(weights_of(network), network.inputs(windows, moment, NOTHING_SEEN, sizes), sizes)
    np.testing.assert_array_equal(out["modes"][:, 0], out["path"])


@pytest.mark.parametrize("count", [30, 300])
def test_points_stand_for_the_standard_normal_distribution(count: int) -> None:
    found = np.array(points(count))
    np.testing.assert_allclose(found.mean(axis=0), 0, atol=0.15)
    np.testing.assert_allclose(np.cov(found.T), np.eye(2), atol=0.25)
