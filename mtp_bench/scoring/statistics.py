"""Uncertainty with scenes as the unit: bootstrap intervals, sign-flip tests, gaps (protocol, "Uncertainty").

A mean over targets is a ratio of sums over scenes: ``numerator`` [S] and ``denominator`` [S] (the number of targets).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError
from ..shapes import require_finite, require_shape

Array = NDArray[np.float64]

RESAMPLES = 2000
LEVEL = 0.95
EXACT_SCENES = 14  # all sign flips up to here
FLIPS = 10_000  # random sign flips beyond
_SEED = 20_250_101


def bootstrap_interval(numerator: ArrayLike, denominator: ArrayLike) -> tuple[float, float] | None:
    """Percentile interval (95 %) of sum(numerator) / sum(denominator) over resampled scenes.

    Scenes without a target (denominator 0) are left out; None with fewer than two others. The resamples depend on the
    number of scenes only, so agents are compared on the same ones.
    """
    top, bottom = as_sums("numerator", numerator), as_sums("denominator", denominator)
    require_shape("numerator", top, bottom.shape)
    if (bottom < 0).any():
        raise ShapeError(f"denominator reaches down to {bottom.min()}, expected counts of 0 or more")
    top, bottom = top[bottom > 0], bottom[bottom > 0]
    if len(bottom) < 2:
        return None
    counts = _resamples(len(bottom))
    means = (counts @ top) / (counts @ bottom)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def paired_interval(a: ArrayLike, b: ArrayLike, denominator: ArrayLike) -> tuple[float, float] | None:
    """Interval of the difference a - b of two means over the same targets: numerators [S], [S], denominator [S]."""
    return bootstrap_interval(as_sums("a", a) - as_sums("b", b), denominator)


class PairedDifference(NamedTuple):
    """Difference of two means over the same targets, in the unit of their numerators."""

    mean: float
    interval: tuple[float, float] | None  # 95 %, over resampled scenes; None with fewer than two scenes
    p: float  # of the sign-flip test over scenes


def paired_difference(a: ArrayLike, b: ArrayLike, denominator: ArrayLike) -> PairedDifference | None:
    """Difference a - b of two means: numerators [S], [S], denominator [S]; None where that is 0 in all scenes."""
    gap = as_sums("a", a) - as_sums("b", b)
    count = as_sums("denominator", denominator)
    mean = ratio(gap.sum(), count.sum())
    return None if mean is None else PairedDifference(mean, bootstrap_interval(gap, count), sign_flip_test(gap))


def ratio(top: float, bottom: float) -> float | None:
    """``top / bottom``; None unless the denominator is above 0."""
    return float(top / bottom) if bottom > 0 else None


def share_interval(part: ArrayLike, whole: ArrayLike) -> tuple[float, float] | None:
    """Percentile interval (95 %) of sum(part) / sum(whole) over resampled scenes, [S] each and of either sign.

    None with fewer than two scenes, or where the whole is not above 0 in nearly all resamples.
    """
    top, bottom = as_sums("part", part), as_sums("whole", whole)
    require_shape("whole", bottom, top.shape)
    if len(bottom) < 2:
        return None
    counts = _resamples(len(bottom))
    total = counts @ bottom
    if (total <= 0).mean() > (1 - LEVEL) / 2:
        return None
    positive = total > 0
    low, high = np.quantile((counts @ top)[positive] / total[positive], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def sign_flip_test(difference: ArrayLike) -> float:
    """Two-sided p of the summed difference [S] per scene, if its sign were a matter of chance in every scene.

    All 2^S signs up to EXACT_SCENES scenes; else FLIPS random ones and the observed one. Scenes without a difference do
    not matter. 1.0 without any.
    """
    gap = as_sums("difference", difference)
    gap = gap[gap != 0]
    count = len(gap)
    if count == 0:
        return 1.0
    # a sum of the same terms in another order is as extreme
    limit = abs(float(gap.sum())) - 1e-12 * float(np.abs(gap).sum())
    if count <= EXACT_SCENES:
        bits = (np.arange(1 << count)[:, None] >> np.arange(count)) & 1
        return float((np.abs((1.0 - 2.0 * bits) @ gap) >= limit).mean())
    signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], size=(FLIPS, count))
    extreme = int((np.abs(signs @ gap) >= limit).sum())
    return (1 + extreme) / (1 + FLIPS)


def as_sums(name: str, values: ArrayLike) -> Array:
    """Sums over the targets of each scene [S] as an array; raises ShapeError for another shape or a NaN."""
    array = np.asarray(values, dtype=np.float64)
    require_shape(name, array, (None,))
    require_finite(name, array)
    return array


@lru_cache(maxsize=64)
def _resamples(scenes: int) -> Array:
    """How often each scene occurs in each resample [RESAMPLES, S]."""
    rng = np.random.default_rng([_SEED, scenes])
    counts = rng.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=RESAMPLES)
    return counts.astype(np.float64)


class Gap(NamedTuple):
    """Share of the gap that is closed."""

    closed: float  # 0: as STP, 1: as on true pasts
    interval: tuple[float, float] | None  # 95 %, over resampled scenes


def gap_closed(error: ArrayLike, stp: ArrayLike, truth: ArrayLike, targets: ArrayLike) -> Gap | None:
    """(E_STP - E) / (E_STP - E_truth) from errors without false forecasts, summed over the targets of each scene [S].

    ``error`` is of the agent, ``stp`` of STP and ``truth`` of STP on true pasts, all with the same k; ``targets`` [S]
    counts them. None where the interval of the denominator covers 0.
    """
    high: Array = as_sums("stp", stp)
    low = as_sums("truth", truth)
    interval = paired_interval(high, low, targets)
    if interval is None or interval[0] <= 0.0 <= interval[1]:
        return None
    closed, whole = high - as_sums("error", error), high - low
    return Gap(float(closed.sum() / whole.sum()), share_interval(closed, whole))
