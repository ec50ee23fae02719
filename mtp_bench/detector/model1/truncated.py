"""Normal numbers that end at a lowest and a highest value: drawn from latent ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Bools, Floats

_BEYOND = 30.0  # deviations from location to limit: beyond, probabilities lose all digits


class _Ends(NamedTuple):
    """Limits in deviations from the location, mirrored where the lower one is above it: tails keep their digits."""

    location: Floats
    low: Floats
    high: Floats
    mirrored: Bools


def within_limits(latent: Floats, location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> Floats:
    """Truncated normal numbers with the ranks of the standard normal ones ``latent``; all ``[R]``.

    ``location`` and ``deviation``: of the numbers before truncation; ``lowest`` and ``highest``: their limits.
    Without deviation: the location, brought within the limits.
    """
    from scipy.special import ndtr, ndtri

    ends = _ends(location, deviation, lowest, highest)
    below = ndtr(ends.low)
    rank = below + ndtr(_turned(latent, ends.mirrored)) * (ndtr(ends.high) - below)
    value = ends.location + _scale(deviation) * _turned(ndtri(rank), ends.mirrored)
    return np.asarray(np.clip(np.where(deviation > 0, value, location), lowest, highest))


def _ends(location: Floats, deviation: Floats, lowest: Floats, highest: Floats) -> _Ends:
    scale = _scale(deviation)
    location = np.clip(location, lowest - _BEYOND * scale, highest + _BEYOND * scale)
    low, high = (lowest - location) / scale, (highest - location) / scale
    mirrored = np.asarray(low > 0)
    return _Ends(location, np.where(mirrored, -high, low), np.where(mirrored, -low, high), mirrored)


def _scale(deviation: Floats) -> Floats:
    return np.asarray(np.where(deviation > 0, deviation, 1.0))


def _turned(value: Floats, mirrored: Bools) -> Floats:
    return np.asarray(np.where(mirrored, -value, value))
