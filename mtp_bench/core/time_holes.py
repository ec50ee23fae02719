"""Holes in the time of a scene, which no past, future or velocity crosses."""

import numpy as np

from .arrays import Floats, Ints

_LONGEST_STEP = 1.5  # frame periods of the task between two frames without a hole
_ROUNDING_S = 1e-6


def longest_step(period: float) -> float:
    """Return the longest step without a hole, s.

    ``period``: nominal time between two frames, s.
    """
    return _LONGEST_STEP * period + _ROUNDING_S


def pieces_of(time: Floats, period: float) -> Ints:
    """Number the pieces of time [F] between holes, for each frame.

    ``time`` [F] s; ``period``: nominal time between two frames, s.
    """
    steps = np.diff(time, prepend=time[:1])
    return np.cumsum(steps > longest_step(period), dtype=int)
