"""Normal numbers between a lowest and a highest value, by the inverse of their distribution function."""

from __future__ import annotations

import numpy as np

from ..types import Floats

_BEYOND = 30.0  # deviations between location and nearer limit; a distribution further out is not told from that one


def within_limits(latent: Floats, location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Truncated normal numbers that have the ranks of standard normal ones; any shape, the same for all.

    Without deviation: the location, brought within the limits.
    """
    from scipy.special import ndtr, ndtri

    low, high, side = _standardised(location, deviation, lowest, highest)
    below, above = ndtr(low), ndtr(-high)
    # Counted from the limit in whose tail both lie, where probabilities keep their digits.
    value = side * ndtri(below + ndtr(side * latent) * (1.0 - below - above))
    tail = low > -_BEYOND
    exact = side * ndtri(below + ndtr(side * latent) * (ndtr(high) - below))
    value = np.where(tail, exact, value)
    inside = np.clip(location + np.where(deviation > 0, deviation * value, 0.0), lowest, highest)
    return np.asarray(inside)
