"""Arrays of rollouts are stored smaller, and come back to the bit."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from mtp_bench.running.packing import join_bytes, pack_forecasts, packed, split_bytes, unpack_forecasts, unpacked

FORECASTS = array_shapes(min_dims=3, max_dims=3, min_side=0, max_side=5).map(lambda shape: (*shape, 2))


@given(arrays(np.int16, FORECASTS))
def test_forecasts_come_back(forecast: NDArray[np.int16]) -> None:
    found = unpack_forecasts(pack_forecasts(forecast))
    assert (found.dtype, found.shape) == (forecast.dtype, forecast.shape)
    np.testing.assert_array_equal(found, forecast)


@given(st.sampled_from(["<f4", "<f8", "<i8"]).flatmap(lambda kind: arrays(kind, array_shapes(min_dims=1, min_side=0))))
def test_numbers_come_back_to_the_bit(array: NDArray[Any]) -> None:
    found = join_bytes(split_bytes(array), array.dtype)
    assert (found.dtype, found.shape, found.tobytes()) == (array.dtype, array.shape, array.tobytes())


def size(array: NDArray[Any]) -> int:
    return len(zlib.compress(array.tobytes()))


def test_steady_motion_is_small() -> None:
    rng = np.random.default_rng(0)
    step, turn = rng.normal(0, 300, (200, 10, 1, 2)), rng.normal(0, 5, (200, 10, 1, 2))
    time = np.arange(1, 13)[:, None]
    forecast = np.rint(step * time + turn * time**2).astype(np.int16)
    assert size(pack_forecasts(forecast)) < 0.5 * size(forecast)


def test_what_is_no_packed_array_is_refused() -> None:
    for wrong in (np.zeros((2, 3, 4), np.uint8), np.zeros((3, 1, 1, 1, 2), np.uint8), np.zeros((2, 1, 1, 1, 2))):
        with pytest.raises(ValueError, match=r"expected bytes \[2, T, S, K, 2\]"):
            unpacked("forecast", wrong, "<i2")
    with pytest.raises(ValueError, match="expected 4 planes of bytes"):
        unpacked("track_box", np.zeros((8, 3, 7), np.uint8), "<f4")
    with pytest.raises(ValueError, match="track_box is not an array"):
        unpacked("track_box", b"no array", "<f4")


def test_whole_numbers_stay_as_they_are() -> None:
    array = np.arange(5)
    assert packed("track_id", array) is array
    assert unpacked("track_id", array, "<i8") is array
