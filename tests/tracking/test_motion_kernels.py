"""The compiled motion filter equals the plain one to the bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mtp_bench.geometry import wrap_angle
from mtp_bench.tracking.kernels import motion_kernels
from mtp_bench.tracking.kernels.motion_kernels import predict, update_pairs, wrap
from mtp_bench.types import Floats, Ints
from tests.support import plain_motion as motion

D = 60


def random_state(rng: np.random.Generator, n: int) -> motion.MotionState:
    mean = rng.normal(0, 10, (n, 10))
    return motion.MotionState(mean, rng.uniform(0.1, 50, (n, 2, 2)), rng.uniform(0.1, 50, n))


def random_detections(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Boxes and velocities; a third of the velocities is not measured."""
    box, velocity = rng.normal(0, 10, (D, 7)), rng.normal(0, 9, (D, 2))
    velocity[::3] = 0
    return box, velocity


def packed(state: motion.MotionState) -> Floats:
    """The states as the kernels take them: [N, 15]."""
    return np.column_stack([state.mean, state.covariance.reshape(-1, 4), state.variance])


def unpacked(rows: Floats) -> motion.MotionState:
    return motion.MotionState(rows[:, :10], rows[:, 10:14].reshape(-1, 2, 2), rows[:, 14])


def assert_same(state: motion.MotionState, expected: motion.MotionState) -> None:
    np.testing.assert_array_equal(state.mean, expected.mean)
    np.testing.assert_array_equal(state.covariance, expected.covariance)
    np.testing.assert_array_equal(state.variance, expected.variance)


def taken(
    state: motion.MotionState,
    leaf: Ints,
    detection: Ints,
    box: Floats,
    velocity: Floats | None,
    dt: float,
    run: Callable[..., Any] = update_pairs,
) -> motion.MotionState:
    """What the kernel writes for pairs; the arrays are longer than needed."""
    e = len(leaf)
    out = np.full((e + 2, 15), np.nan)
    run(packed(state), leaf, detection, box, np.zeros((0, 2)) if velocity is None else velocity, dt, out)
    assert np.isnan(out[e:]).all()
    return unpacked(out[:e])


def moved(state: motion.MotionState, run: Callable[[Floats], None] = predict) -> motion.MotionState:
    """The states a frame later."""
    rows = packed(state)
    run(rows)
    return unpacked(rows)


def test_the_constants_are_those_of_the_plain_filter() -> None:
    names = [name for name in vars(motion) if name.isupper()]
    assert len(names) == 6
    assert [getattr(motion_kernels, name) for name in names] == [getattr(motion, name) for name in names]


def test_angles_are_wrapped_alike() -> None:
    rng = np.random.default_rng(0)
    edges = [
        0.0,
        -0.0,
        np.pi,
        -np.pi,
        np.nextafter(-np.pi, -9),
        np.nextafter(np.pi, 9),
        1e-300,
        -1e-17,
        -3 * np.pi,
        1e17,
    ]
    angle = np.concatenate([rng.uniform(-20, 20, 3000), rng.normal(0, 1e6, 1000), edges, np.arange(-9, 9) * np.pi / 2])
    wrapped = np.array([wrap(a) for a in angle])
    np.testing.assert_array_equal(wrapped, wrap_angle(angle))
    np.testing.assert_array_equal(np.signbit(wrapped), np.signbit(wrap_angle(angle)))
    assert np.isnan(wrap(np.nan))


@pytest.mark.parametrize("n", [0, 1, 300])
def test_prediction(n: int) -> None:
    state = random_state(np.random.default_rng(n), n)
    assert_same(moved(state), motion.predicted(state))


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("dt", [0.1, 0.2, 0.5, 1.0, 1 / 7])
def test_updates_births_and_frames_without_a_detection(dt: float, measured: bool) -> None:
    rng = np.random.default_rng(4)
    state = random_state(rng, 90)
    box, velocity = random_detections(rng)
    leaf, detection = rng.integers(-1, 90, 2000), rng.integers(0, D, 2000)
    leaf[:100] = -1
    detection[(leaf >= 0) & (rng.random(2000) < 0.3)] = -1
    result = taken(state, leaf, detection, box, velocity if measured else None, dt)

    def seen(rows: Ints) -> Floats | None:
        return velocity[detection[rows]] if measured else None

    hit, born, unseen = (np.flatnonzero(m) for m in ((leaf >= 0) & (detection >= 0), leaf < 0, detection < 0))
    assert min(len(hit), len(born), len(unseen)) > 50
    expected = motion.updated(state.take(leaf[hit]), box[detection[hit]], seen(hit), dt)
    assert_same(result.take(hit), expected)
    assert_same(result.take(born), motion.born(box[detection[born]], seen(born), dt))
    assert_same(result.take(unseen), state.take(leaf[unseen]))


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2, 1.6, 3.0, np.pi, -np.pi, -1.58, 6.0])
def test_detections_that_face_the_other_way(turn: float) -> None:
    state = motion.born(np.array([[0, 0, 0, 0.3, 4, 2, 1.5]]))
    box = np.array([[0.5, 0, 0, 0.3 + turn, 4, 2, 1.5]])
    one = np.zeros(1, dtype=np.int64)
    assert_same(taken(state, one, one, box, None, 0.1), motion.updated(state, box))


def test_over_many_frames() -> None:
    rng = np.random.default_rng(7)
    box, velocity = random_detections(rng)
    state, leaf = motion.born(box, velocity, 0.5), np.arange(D)
    plain = state
    for _ in range(50):
        plain = motion.updated(motion.predicted(plain), box, velocity, 0.5)
        state = taken(moved(state), leaf, leaf, box, velocity, 0.5)
        box = box + rng.normal(0, 1, box.shape)
    assert_same(state, plain)


def test_plain_python_gives_the_same() -> None:
    rng = np.random.default_rng(2)
    state = random_state(rng, 5)
    box, velocity = random_detections(rng)
    leaf, detection = np.array([0, 4, -1, 2, 2]), np.array([3, -1, 1, 7, 8])
    compiled = taken(state, leaf, detection, box, velocity, 0.5)
    assert_same(taken(state, leaf, detection, box, velocity, 0.5, update_pairs.function), compiled)
    assert_same(moved(state, predict.function), moved(state))
