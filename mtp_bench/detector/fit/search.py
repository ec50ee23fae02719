"""Search for parameters whose simulated figures are nearest to those of a real detector."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from ...types import Floats

_STEP = 0.25  # of every unknown, for slopes: simulated figures are not smooth
_PRIOR = 0.15  # pull towards the start, for unknowns that the figures do not determine
_FARTHEST = 4.5  # unknowns are log-odds or logarithms
_ROUNDS = 8


def nearest_parameters(figures: Callable[[Floats], Floats], real: Floats, scale: Floats, start: Floats) -> Floats:
    """Unknowns with ``figures`` nearest to the ``real`` ones that are known, in units of ``scale``."""
    finite = np.isfinite(real)

    def loss(unknown: Floats) -> Floats:
        difference = (np.nan_to_num(figures(unknown)) - real)[finite] / scale[finite]
        return np.concatenate([difference, _PRIOR * (unknown - start)])

    def slope(unknown: Floats) -> Floats:
        current = loss(unknown)
        return np.stack([loss(unknown + step) - current for step in _STEP * np.eye(len(start))], axis=-1) / _STEP

    return np.asarray(least_squares(loss, start, slope, (-_FARTHEST, _FARTHEST), "dogbox", max_nfev=_ROUNDS).x)


def from_log_odds(log_odds: float) -> float:
    """Share with these log-odds."""
    return float(1.0 / (1.0 + np.exp(-log_odds)))
