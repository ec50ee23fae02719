"""Bounds of what a detector estimates of a box."""

from __future__ import annotations

import numpy as np

from ..types import Floats

FARTHEST = 2.0  # m: a position error beyond would be another object's detection
ROBUST_T4 = 1.4826 * 0.7406970841  # robust standard deviation of Student's t with 4 degrees of freedom
_SMALLEST = 0.2, 0.3  # m and share of the true size: no side of a box is estimated below the larger of both


def sized(true: Floats, error: Floats) -> Floats:
    """Estimated sides ``[R, 3]`` of boxes with ``true`` ones, none of them too small."""
    smallest = np.minimum(true, np.maximum(_SMALLEST[0], _SMALLEST[1] * true))
    return np.asarray(np.maximum(true + error, smallest))
