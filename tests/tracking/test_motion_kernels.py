"""The compiled motion filter against the textbook one."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.geometry import wrap_angle
from mtp_bench.tracking.kernels.motion_kernels import predict, update_pairs, wrap
from mtp_bench.types import Floats, Ints
from tests.support import plain_tracker as textbook


def random_states(rng: np.random.Generator, n: int) -> Floats:
    """States [n, 15] with symmetric, positive covariances."""
    root = rng.normal(0, 3, (n, 2, 2))
    covariance = root @ root.transpose(0, 2, 1) + np.eye(2)
    return np.column_stack([rng.normal(0, 10, (n, 10)), covariance.reshape(n, 4), rng.uniform(0.1, 50, n)])


def random_detections(rng: np.random.Generator, n: int = 60) -> tuple[Floats, Floats]:
    """Boxes and velocities; a third of the velocities is not measured."""
    box, velocity = rng.normal(0, 10, (n, 7)), rng.normal(0, 9, (n, 2))
    velocity[::3] = 0
    return box, velocity


def unpacked(row: Floats) -> textbook.State:
    """Mean and full covariance of a state [15]."""
    covariance = np.diag(np.append([row[10]] * 3, [row[14]] * 4 + [row[13]] * 3))
    covariance[range(3), range(7, 10)], covariance[range(7, 10), range(3)] = row[11], row[12]
    return row[:10], covariance


def assert_same(row: Floats, expected: textbook.State) -> None:
    for value, other in zip(unpacked(row), expected, strict=True):
        np.testing.assert_allclose(value, other, rtol=1e-9, atol=1e-9)


def taken(state: Floats, leaf: Ints, detection: Ints, box: Floats, velocity: Floats, dt: float) -> Floats:
    """States that the kernel writes for pairs; its output array is longer than needed."""
    out = np.full((len(leaf) + 2, 15), np.nan)
    update_pairs(state, leaf, detection, box, velocity, dt, out)
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


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("dt", [0.1, 0.5, 1 / 7])
def test_updates_births_and_frames_without_a_detection(dt: float, measured: bool) -> None:
    rng = np.random.default_rng(4)
    state, (box, velocity) = random_states(rng, 90), random_detections(rng)
    leaf, detection = rng.integers(-1, 90, 300), rng.integers(0, len(box), 300)
    leaf[:50] = -1
    detection[(leaf >= 0) & (rng.random(300) < 0.3)] = -1
    result = taken(state, leaf, detection, box, velocity if measured else velocity[:0], dt)
    for row, i, d in zip(result, leaf, detection, strict=True):
        before = unpacked(state[i]) if i >= 0 else None
        if d >= 0:
            before = textbook.updated(before, box[d], velocity[d] * measured, dt)
        assert before is not None
        assert_same(row, before)


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2, 1.6, 3.0, np.pi, -np.pi, -1.58, 6.0])
def test_detections_that_face_the_other_way(turn: float) -> None:
    one, none = np.zeros(1, dtype=np.int64), np.zeros((0, 2))
    state = taken(np.zeros((0, 15)), one - 1, one, np.array([[0, 0, 0, 0.3, 4, 2, 1.5]]), none, 0.1)
    box = np.array([[0.5, 0, 0, 0.3 + turn, 4, 2, 1.5]])
    assert_same(taken(state, one, one, box, none, 0.1)[0], textbook.updated(unpacked(state[0]), box[0], np.zeros(2), 1))


def test_over_many_frames() -> None:
    rng, all_rows = np.random.default_rng(7), np.arange(10)
    box, velocity = random_detections(rng, 10)
    state = taken(np.zeros((0, 15)), all_rows * 0 - 1, all_rows, box, velocity, 0.5)
    plain = [textbook.updated(None, *pair, 0.5) for pair in zip(box, velocity, strict=True)]
    for _ in range(30):
        box = box + rng.normal(0, 1, box.shape)
        predict(state)
        state = taken(state, all_rows, all_rows, box, velocity, 0.5)
        plain = [textbook.updated(textbook.predicted(plain[i]), box[i], velocity[i], 0.5) for i in all_rows]
    for row, expected in zip(state, plain, strict=True):
        assert_same(row, expected)


def test_plain_python_gives_the_same() -> None:
    rng = np.random.default_rng(2)
    state, (box, velocity) = random_states(rng, 5), random_detections(rng)
    pairs = np.array([0, 4, -1, 2, 2]), np.array([3, -1, 1, 7, 8])
    out = np.zeros((5, 15))
    update_pairs.function(state, *pairs, box, velocity, 0.5, out)
    np.testing.assert_array_equal(out, taken(state, *pairs, box, velocity, 0.5))
    moved = state.copy()
    predict(moved)
    predict.function(state)
    np.testing.assert_array_equal(moved, state)
