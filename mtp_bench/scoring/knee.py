"""Where a falling curve stops to pay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def knee(cost: Sequence[float], error: Sequence[float]) -> int | None:
    """Place of the knee of ``error`` over ``cost``, both of one length, cost rising; None where there is none.

    Both axes are scaled to one; the knee is the point farthest below the straight line from the first point to the
    last (Satopaa et al. 2011, "Finding a kneedle in a haystack", without smoothing). None with fewer than three points,
    where the last error is not below the first, and where no point lies below the line.
    """
    at, value = np.asarray(cost, dtype=np.float64), np.asarray(error, dtype=np.float64)
    if len(at) < 3 or value[-1] >= value[0] or at[-1] <= at[0]:
        return None
    along = (at - at[0]) / (at[-1] - at[0])
    fallen = (value[0] - value) / (value[0] - value[-1])
    below = fallen - along
    place = int(np.argmax(below))
    return place if below[place] > 1e-9 else None
