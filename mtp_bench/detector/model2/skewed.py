"""Numbers of variance 1 whose one tail is exponential: a normal number, and a loss or gain that is small mostly."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...types import Floats

_HALVINGS = 60


def exponential(latent: Floats) -> Floats:
    """Exponential numbers of mean 1 with the ranks of standard normal ones."""
    from scipy.special import log_ndtr

    return np.asarray(-log_ndtr(-latent))


def raised(normal: Floats, tail: Floats, share: Floats | float) -> Floats:
    """``normal`` and, for ``share`` of the variance, the exponential number of the rank of the normal one ``tail``."""
    return with_exponential(normal, exponential(tail), share)


def with_exponential(normal: Floats, positive: Floats, share: Floats | float) -> Floats:
    """The same with the exponential number itself."""
    return np.asarray(np.sqrt(1.0 - share) * normal + np.sqrt(share) * (positive - 1.0))


def below(value: Floats, share: Floats | float) -> Floats:
    """Chance that a number of `raised` is below ``value``."""
    from scipy.special import log_ndtr, ndtr

    rest, scale = np.sqrt(1.0 - share), np.sqrt(np.maximum(share, 1e-6))
    y = value + scale
    slope = np.minimum(-y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale), 0.0)
    return np.asarray(np.where(np.asarray(share) > 0, np.clip(ndtr(y / rest) - np.exp(slope), 0.0, 1.0), ndtr(value)))


def density(value: Floats, share: float) -> Floats:
    """Density of a number of `raised`."""
    from scipy.special import log_ndtr

    if share == 0:
        return np.asarray(np.exp(-0.5 * value**2) / np.sqrt(2 * np.pi))
    rest, scale = np.sqrt(1.0 - share), np.sqrt(share)
    y = value + scale
    return np.asarray(np.exp(-y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale)) / scale)


@lru_cache(maxsize=256)
def exceeded(chance: float, share: float) -> float:
    """What a number of `raised` exceeds with a chance."""
    low, high = -12.0, 60.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if float(below(np.asarray(middle), share)) < 1.0 - chance else (low, middle)
    return (low + high) / 2
