"""Checks of array shapes and contents at the public boundaries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ShapeError


def require_shape(name: str, array: NDArray[Any], shape: tuple[int | None, ...]) -> None:
    """Raise ShapeError unless ``array`` has ``shape``; None stands for any length."""
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        want = tuple("any" if n is None else n for n in shape)
        raise ShapeError(f"{name} has shape {array.shape}, expected {want}")


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Raise ShapeError naming the first entry of ``array`` that is NaN or infinite."""
    bad = ~np.isfinite(array)
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ShapeError(f"{name}{list(index)} is {array[index]}, expected a finite number ({int(bad.sum())} such)")
