"""Lossless transforms of the arrays of rollouts, after which they compress well.

Forecasts are most of a rollout. Objects move steadily, so the second differences of a sample over time are small. The
high bytes of such numbers are mostly equal, so bytes of equal significance are stored together.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


def packed(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """The array ``name`` of a rollout as it is stored."""
    if name == "forecast":
        return pack_forecasts(array)
    return split_bytes(array) if array.dtype.kind == "f" else array


def unpacked(name: str, stored: NDArray[Any] | bytes, dtype: str) -> NDArray[Any]:
    """The array ``name`` of a rollout from its stored form; raises ValueError for a form of another shape or dtype."""
    if isinstance(stored, bytes):  # np.load returns other members of an archive so
        raise ValueError(f"{name} is not an array")
    if name == "forecast":
        return unpack_forecasts(stored)
    kind = np.dtype(dtype)
    return join_bytes(stored, kind) if kind.kind == "f" else stored


def pack_forecasts(forecast: NDArray[np.int16]) -> Bytes:
    """Bytes [2, T, S, K, 2] of the second differences over time of forecasts [S, K, T, 2], the low bytes first."""
    steps = np.ascontiguousarray(np.moveaxis(forecast, 2, 0)).view(np.uint16)  # time first: equal values lie together
    for _ in range(2):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))  # wraps around on overflow
    signed = steps.view(np.int16)
    return split_bytes((signed << 1) ^ (signed >> 15))  # 0, -1, 1, -2 ... as 0, 1, 2, 3 ...: small without a sign


def unpack_forecasts(packed: Bytes) -> NDArray[np.int16]:
    """Inverse of `pack_forecasts`: forecasts [S, K, T, 2]; ValueError for another shape."""
    if packed.dtype != np.uint8 or packed.ndim != 5 or packed.shape[0] != 2 or packed.shape[-1] != 2:
        raise ValueError(f"{packed.dtype} {list(packed.shape)}, expected bytes [2, T, S, K, 2]")
    folded = packed[1].astype(np.uint16)
    folded <<= 8
    folded |= packed[0]
    steps = folded >> 1
    steps ^= np.negative(folded & 1)
    for _ in range(2):
        for before, after in pairwise(steps):
            np.add(before, after, out=after)
    pairs = steps.view(np.uint32)[..., 0]  # x and y are moved as one
    moved = np.ascontiguousarray(np.moveaxis(pairs, 0, 2))
    return moved.view(np.int16).reshape(*moved.shape, 2)


def split_bytes(array: NDArray[Any]) -> Bytes:
    """The bytes [itemsize, ...] of the numbers, those of equal significance together."""
    planes = np.ascontiguousarray(array)[..., None].view(np.uint8)
    return np.ascontiguousarray(np.moveaxis(planes, -1, 0))


def join_bytes(planes: Bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Inverse of `split_bytes`; ValueError for planes that are not those of ``dtype``."""
    if planes.dtype != np.uint8 or planes.shape[:1] != (dtype.itemsize,):
        raise ValueError(f"{planes.dtype} {list(planes.shape)}, expected {dtype.itemsize} planes of bytes")
    return np.ascontiguousarray(np.moveaxis(planes, 0, -1)).view(dtype)[..., 0]
