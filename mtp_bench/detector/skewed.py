"""Numbers of variance 1 with one exponential tail: a normal number plus a centred exponential one.

``share`` is the exponential number's share of the variance.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..types import Floats

_HALVINGS = 60


def exponential(latent: Floats) -> Floats:
    """Exponential numbers of mean 1 with the ranks of standard normal ones."""
    from scipy.special import log_ndtr

    return np.asarray(-log_ndtr(-latent))


def skewed(normal: Floats, positive: Floats, share: Floats | float) -> Floats:
    """Skewed numbers from standard normal ones and exponential ones of mean 1."""
    return np.asarray(np.sqrt(1.0 - share) * normal + np.sqrt(share) * (positive - 1.0))


def skewed_cdf(value: Floats, share: Floats | float) -> Floats:
    """Distribution function of `skewed` numbers."""
    from scipy.special import log_ndtr, ndtr

    rest, scale = np.sqrt(1.0 - share), np.sqrt(np.maximum(share, 1e-6))
    y = value + scale
    slope = np.minimum(-y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale), 0.0)
    return np.asarray(np.where(np.asarray(share) > 0, np.clip(ndtr(y / rest) - np.exp(slope), 0.0, 1.0), ndtr(value)))


def skewed_density(value: Floats, share: float) -> Floats:
    """Density of `skewed` numbers."""
    from scipy.special import log_ndtr

    if share == 0:
        return np.asarray(np.exp(-0.5 * value**2) / np.sqrt(2 * np.pi))
    rest, scale = np.sqrt(1.0 - share), np.sqrt(share)
    y = value + scale
    return np.asarray(np.exp(-y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale)) / scale)


@lru_cache(maxsize=256)
def skewed_quantile(chance: float, share: float) -> float:
    """Value that `skewed` numbers exceed with a chance."""
    low, high = -12.0, 60.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if float(skewed_cdf(np.asarray(middle), share)) < 1.0 - chance:
            low = middle
        else:
            high = middle
    return (low + high) / 2
