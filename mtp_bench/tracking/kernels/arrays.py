"""New arrays. Numba compiles NumPy's own functions anew for every kernel that calls them; these are compiled once."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .compile import kernel


@kernel("i8[::1](i8)")
def ints(n: int) -> Ints:
    """Whole numbers [n], not set."""
    return np.empty(n, np.int64)


@kernel("i8[::1](i8, i8)")
def ints_of(n: int, value: int) -> Ints:
    """Whole numbers [n], all ``value``."""
    array = ints(n)
    for i in range(n):
        array[i] = value
    return array


@kernel("f8[::1](i8)")
def floats(n: int) -> Floats:
    """Numbers [n], not set."""
    return np.empty(n, np.float64)


@kernel("f8[::1](i8, f8)")
def floats_of(n: int, value: float) -> Floats:
    """Numbers [n], all ``value``."""
    array = floats(n)
    for i in range(n):
        array[i] = value
    return array


@kernel("b1[::1](i8)")
def flags(n: int) -> Bools:
    """False [n]."""
    array = np.empty(n, np.bool_)
    for i in range(n):
        array[i] = False
    return array


@kernel("i8[:, ::1](i8, i8)")
def int_table(n: int, m: int) -> Ints:
    """Whole numbers [n, m], not set."""
    return np.empty((n, m), np.int64)


@kernel("f8[:, ::1](i8, i8)")
def float_table(n: int, m: int) -> Floats:
    """Numbers [n, m], not set."""
    return np.empty((n, m), np.float64)


@kernel("b1[:, ::1](i8, i8)")
def flag_table(n: int, m: int) -> Bools:
    """False [n, m]."""
    array = np.empty((n, m), np.bool_)
    for i in range(n):
        for j in range(m):
            array[i, j] = False
    return array


@kernel("i8[::1](i8)")
def up_to(n: int) -> Ints:
    """0 to n - 1, [n]."""
    array = ints(n)
    for i in range(n):
        array[i] = i
    return array


@kernel("i8[::1](i8[::1], i8)")
def first_ints(array: Ints, n: int) -> Ints:
    """The first ``n`` of the array, copied."""
    copied = ints(n)
    for i in range(n):
        copied[i] = array[i]
    return copied


@kernel("f8[::1](f8[::1], i8)")
def first_floats(array: Floats, n: int) -> Floats:
    """The first ``n`` of the array, copied."""
    copied = floats(n)
    for i in range(n):
        copied[i] = array[i]
    return copied


@kernel("f8[:, ::1](i8, i8)")
def zeros(n: int, m: int) -> Floats:
    """Zero [n, m]."""
    array = float_table(n, m)
    for i in range(n):
        for j in range(m):
            array[i, j] = 0.0
    return array
