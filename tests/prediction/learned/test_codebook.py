"""The codebook: which deviations from constant velocity it finds, for which objects."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from mtp_bench.prediction.learned import codebook
from mtp_bench.prediction.learned.codebook import Codebook, group_of
from mtp_bench.prediction.learned.local import Arrays
from mtp_bench.prediction.learned.network import Sizes

SIZES = Sizes(("car", "pedestrian"), past=3, future=2, modes=2, dt=0.5)
SIDES = np.array([[[0, 1], [0, 2]], [[0, -1], [0, -2]]], dtype=np.float32)  # to the left and to the right


def moving(class_id: int, speed: float, count: int, alive: int = 3) -> Arrays:
    """Straight pasts along x, known for ``alive`` frames."""
    age = SIZES.dt * np.arange(SIZES.past)[::-1]
    position = np.zeros((count, SIZES.past, 2), dtype=np.float32)
    position[:, :, 0] = -speed * age
    known = np.broadcast_to(np.arange(SIZES.past) >= SIZES.past - alive, position.shape[:2]).astype(np.float32)
    return {
        "position": position * known[:, :, None], "alive": known, "velocity": np.zeros_like(position),
        "class_id": np.full(count, class_id),
    }  # fmt: skip


def together(*parts: Arrays) -> Arrays:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def ahead(speed: float) -> np.ndarray:
    return np.array([[speed * 0.5, 0], [speed, 0]], dtype=np.float32)


def fitted(inputs: Arrays, future: np.ndarray) -> Arrays:
    weights = Codebook().start(inputs, future, np.ones(future.shape[:2], dtype=bool), SIZES, 0)
    assert {name: value.shape for name, value in weights.items()} == Codebook().shapes(SIZES)
    return weights


def by_weight(said: Arrays) -> list[tuple[list[list[float]], float]]:
    """Modes of the first window with their weights, the likeliest first."""
    order = np.argsort(-said["log_weight"][0])
    return [(said["modes"][0, mode].round(4).tolist(), float(np.exp(said["log_weight"][0, mode]))) for mode in order]


def test_deviations_are_found_with_their_shares(monkeypatch: pytest.MonkeyPatch) -> None:
    # Fast cars turn: three of four to the left. Pedestrians go on straight or stop.
    monkeypatch.setattr(codebook, "FEW", 10)
    turning = ahead(8.0) + SIDES[[0, 0, 0, 1]].repeat(25, axis=0)
    walking = np.stack([ahead(1.5), ahead(1.5) * 0]).repeat(20, axis=0)
    weights = fitted(together(moving(0, 8.0, 100), moving(1, 1.5, 40)), np.concatenate([turning, walking]))
    (left, much), (right, little) = by_weight(Codebook().forward(weights, moving(0, 9.0, 1), SIZES))
    assert left == (ahead(9.0) + SIDES[0]).tolist()
    assert right == (ahead(9.0) + SIDES[1]).tolist()
    assert [much, little] == pytest.approx([0.75, 0.25], abs=0.01)
    said = Codebook().forward(weights, moving(1, 1.5, 1), SIZES)
    assert sorted(mode for mode, _ in by_weight(said)) == [ahead(0.0).tolist(), ahead(1.5).tolist()]


def test_a_group_with_too_little_is_served_by_all_classes_then_by_all_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codebook, "FEW", 10)
    weights = fitted(moving(0, 8.0, 40), ahead(8.0) + SIDES.repeat(20, axis=0))
    for inputs in (moving(1, 8.0, 1), moving(1, 3.0, 1), moving(0, 8.0, 1, alive=2)):
        off = weights["code.mean"][group_of(inputs, SIZES)[0]]
        np.testing.assert_allclose(off[np.argsort(off[:, 0, 1])], SIDES[::-1], atol=1e-5)


def test_of_nothing_it_is_constant_velocity() -> None:
    weights = fitted(moving(0, 8.0, 3), ahead(8.0) + SIDES[[0, 1, 0]])
    said = Codebook().forward(weights, moving(0, 2.0, 1), SIZES)
    assert [mode for mode, _ in by_weight(said)] == [ahead(2.0).tolist()] * 2
    assert [weight for _, weight in by_weight(said)] == pytest.approx([0.5, 0.5])
    assert said["present"].tolist() == [[0, 0]]


def test_futures_that_are_cut_short_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codebook, "FEW", 10)
    future = ahead(8.0) + SIDES.repeat(20, axis=0)
    known = np.ones((40, 2), dtype=bool)
    future[20:, 1], known[20:, 1] = 99.0, False
    weights = Codebook().start(moving(0, 8.0, 40), future, known, SIZES, 0)
    np.testing.assert_allclose(weights["code.mean"], np.broadcast_to(SIDES[0], (36, 2, 2, 2)), atol=1e-5)


def test_numpy_gives_what_torch_gives() -> None:
    inputs = together(moving(0, 8.0, 40), moving(1, 0.0, 3, alive=1))
    weights = fitted(inputs, np.random.default_rng(0).normal(size=(43, 2, 2)).astype(np.float32))
    ours = Codebook().forward(weights, inputs, SIZES)
    tensors, given = ({name: torch.from_numpy(value) for name, value in part.items()} for part in (weights, inputs))
    for name, value in Codebook().forward(tensors, given, SIZES).items():
        np.testing.assert_allclose(ours[name], value.numpy(), atol=1e-6)
