"""The compiled motion filter against the textbook one."""

import numpy as np
import pytest

from mtp_bench.geometry import wrap_angle
from mtp_bench.tracking.kernels.motion_kernels import update_pairs, wrap
from mtp_bench.types import Floats, Ints
from tests.support import plain_tracker as textbook


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


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2, 1.6, 3.0, np.pi, -np.pi, -1.58, 6.0])
def test_detections_that_face_the_other_way(turn: float) -> None:
    one, none = np.zeros(1, dtype=np.int64), np.zeros((0, 2))
    state = taken(np.zeros((0, 15)), one - 1, one, np.array([[0, 0, 0, 0.3, 4, 2, 1.5]]), none, 0.1)
    box = np.array([[0.5, 0, 0, 0.3 + turn, 4, 2, 1.5]])
    assert_same(taken(state, one, one, box, none, 0.1)[0], textbook.updated(unpacked(state[0]), box[0], np.zeros(2), 1))
