"""What can be counted of false positives: rates, places, scores, classes; the rest of their parameters is a start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....types import Bools, Floats
from ...fit.samples import FalsePositiveSamples
from ..near import BESIDE
from ..neighbours import neighbours_of
from ..profile import QUANTILES, RANKS, SLOTS, FreeGhosts, NearGhosts
from .ghost_figures import NEAR
from .search import odds

_FEW = 20  # from which quantiles are taken
_NEAREST = 2.0  # m: the sensor's own vehicle is there
_FADES = 1.0  # s in which the autoregression sinks to 1 / e
_PLACES = tuple(np.linspace(0.0, 1.0, QUANTILES))


def first_near(real: FalsePositiveSamples, near: Bools, boxes: int, dt: float) -> NearGhosts | None:
    """False positives ``near`` true boxes, of which there are ``boxes``; ``dt`` s between frames.

    None: there are none.
    """
    if not near.any() or not boxes:
        return None
    return NearGhosts(
        chance=round(min(float(near.sum()) / boxes / SLOTS, 1.0), 5),
        score=_quantiles(real.score[near], RANKS),
        offset=_quantiles(real.beside[near]),
        same=_same(real, near),
        duplicates=duplicates_of(real, near),
        **memory_of(1.0, 0.0, dt),
    )


def duplicates_of(real: FalsePositiveSamples, near: Bools) -> tuple[float, ...] | None:
    """Quantiles of the scores of duplicates; None where there are too few."""
    beside = near & real.of_class & (real.beside < BESIDE[0])
    return _quantiles(real.score[beside], RANKS) if beside.sum() >= _FEW else None


def _same(real: FalsePositiveSamples, near: Bools) -> tuple[float, float, float]:
    """Shares with the class of the true box, by distance from it; all where none is."""
    place = np.digitize(real.beside, BESIDE)
    rows = [near & (place == one) for one in range(3)]
    first, second, third = (round(float(real.of_class[one].mean()) if one.any() else 1.0, 4) for one in rows)
    return first, second, third


def first_free(real: FalsePositiveSamples, free: Bools, frames: int, dt: float) -> FreeGhosts | None:
    """False positives that are ``free``, over ``frames`` frames of ``dt`` s. None: there are none."""
    if not free.any():
        return None
    count = np.bincount(real.scene[free] * 100_000 + real.frame[free])
    count = count[count > 0]
    rate = float(free.sum()) / frames
    apart = _apart(real, free)
    return FreeGhosts(
        rate=round(rate, 4),
        dispersion=round(max(float((count**2).sum()) / frames / rate - rate, 1.0), 4),
        chance=0.15,
        survive=0.88,
        siblings=0.4,
        spread=round(float(np.median(apart)) / 1.3 if len(apart) else 1.0, 3),
        family=0.5,
        size=tuple(round(float(one), 4) for one in real.size[free].mean(axis=0)),  # type: ignore[arg-type]
        distance=_quantiles(np.maximum(real.distance[free], _NEAREST)),
        score=_quantiles(real.score[free], RANKS),
        **memory_of(1.0, 0.0, dt),
    )


def _apart(real: FalsePositiveSamples, free: Bools) -> Floats:
    """Distances of pairs of a frame within 3 m."""
    pairs = neighbours_of(real.place[free], (real.scene * 100_000 + real.frame)[free], np.arange(free.sum()), NEAR)
    return np.asarray(np.hypot(*(real.place[free][pairs.row] - real.place[free][pairs.other]).T))


def _quantiles(value: Floats, share: Sequence[float] = _PLACES) -> tuple[float, ...]:
    return tuple(round(float(one), 4) for one in np.quantile(value, share))


def memory_of(lasting: float, constant: float, dt: float) -> dict[str, float]:
    """Shares of the variance by log-odds: of what lasts, and of what is constant among that."""
    lasts, stays = odds(lasting), odds(constant)
    bias, ar = round(lasts * stays, 4), round(lasts * (1 - stays), 4)
    return {"bias": bias, "ar": ar, "phi": round(float(np.exp(-dt / _FADES)), 4), "white": round(1.0 - bias - ar, 4)}
