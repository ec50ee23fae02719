"""Normal numbers that end at a lowest and a highest value: drawn from latent ones."""

from __future__ import annotations

import numpy as np

from ...types import Floats

_BEYOND = 30.0  # deviations from location to limit: beyond, probabilities lose all digits


def within_limits(latent: Floats, location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Truncated normal numbers with the ranks of the standard normal ones ``latent``; all ``[R]``.

    ``location`` and ``deviation``: of the numbers before truncation; ``lowest`` and ``highest``: their limits.
    Without deviation: the location, brought within the limits.
    """
    from scipy.special import ndtr, ndtri

    scale = np.where(deviation > 0, deviation, 1.0)
    middle = np.clip(location, lowest - _BEYOND * scale, highest + _BEYOND * scale)
    low, high = (lowest - middle) / scale, (highest - middle) / scale
    mirrored = low > 0  # where the lower limit is above the location: tails keep their digits
    sign = np.where(mirrored, -1.0, 1.0)
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    below = ndtr(low)
    rank = below + ndtr(sign * latent) * (ndtr(high) - below)
    value = middle + scale * (sign * ndtri(rank))
    return np.asarray(np.clip(np.where(deviation > 0, value, location), lowest, highest))
