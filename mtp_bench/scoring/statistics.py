"""Uncertainty: studentised intervals, sign-flip tests and the intervals that invert them, gaps (docs/definitions).

Units are recordings cut into blocks of at most 20 s. A weighted mean over targets is a ratio of sums over units:
``numerator`` [U] and ``denominator`` [U], the weight of the targets.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Bools, Floats, ShapeError, require_finite, require_shape
from .definitions import RANKED_UNITS, SIGNIFICANT

RESAMPLES = 2000
LEVEL = 0.95
LEAST_UNITS = 3  # of an interval
_WIDEST = 0.995  # quantile of Student's t: no 95 % interval is wider than the 99 % interval of normal units
EXACT_UNITS = 14  # all sign flips up to here
FLIPS = 10_000  # random sign flips beyond
ROUNDING = 1e-12  # relative difference up to which two numbers count as equal
_SEED = 20_250_101
_TOGETHER = 64  # differences whose sums are flipped in one product


def bootstrap_interval(
    numerator: ArrayLike, denominator: ArrayLike
) -> tuple[float, float] | None:
    """Studentised bootstrap interval (95 %) of sum(numerator) / sum(denominator) over resampled units.

    The error of each resample's mean is taken in units of that resample's own standard error, so that the interval is
    wide enough for few and unequal units; the percentile interval is not (Efron and Tibshirani 1993, ch. 12). Units
    without weight (denominator 0) are left out; None with fewer than three others, since resamples of two units do
    not estimate an error. The resamples depend on the number of units only, so agents are compared on the same ones.
    If no sum is below 0, neither is the interval.
    """
    top, bottom = as_sums("numerator", numerator), as_sums("denominator", denominator)
    require_shape("numerator", top, bottom.shape)
    if (bottom < 0).any():
        raise ShapeError(
            f"denominator reaches down to {bottom.min()}, expected weights of 0 or more"
        )
    return _interval(top[bottom > 0].tobytes(), bottom[bottom > 0].tobytes())


@lru_cache(
    maxsize=8192
)  # a leaderboard needs the difference of the same reference pair with every agent
def _interval(numerator: bytes, denominator: bytes) -> tuple[float, float] | None:
    top, bottom = np.frombuffer(numerator), np.frombuffer(denominator)
    if len(bottom) < LEAST_UNITS:
        return None
    mean, error = _mean_and_error(np.ones((1, len(bottom))), top, bottom)
    means, errors = _mean_and_error(_resamples(len(bottom)), top, bottom)
    known = errors > 1e-9 * max(
        float(error[0]), 1e-300
    )  # not those that drew one unit again and again
    if error[0] == 0 or not known.any():
        return float(mean[0]), float(mean[0])
    t = (means[known] - mean[0]) / errors[known]
    most = _widest(len(bottom))
    low, high = np.clip(np.quantile(t, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]), -most, most)
    least = 0.0 if top.min() >= 0 else -np.inf
    return max(float(mean[0] - high * error[0]), least), float(mean[0] - low * error[0])


@lru_cache(maxsize=64)
def _widest(units: int) -> float:
    """Largest half-width of an interval in standard errors, which resamples of few units estimate badly."""
    from scipy.special import stdtrit  # scipy.stats takes seconds to import

    return float(stdtrit(units - 1, _WIDEST))


def _mean_and_error(
    counts: Floats, top: Floats, bottom: Floats
) -> tuple[Floats, Floats]:
    """Mean and its standard error [B] of resamples that hold each unit ``counts`` [B, U] times."""
    weight = counts @ bottom
    mean = (counts @ top) / weight
    # unit by unit: in a difference of sums of squares, rounding gives an error to resamples of one unit alone
    square = (counts * (top - mean[:, None] * bottom) ** 2).sum(axis=1)
    units = counts.sum(axis=1)
    return mean, np.sqrt(square * units / np.maximum(units - 1.0, 1.0)) / weight


def effective_number(weight: ArrayLike) -> float:
    """Effective sample size (Kish 1965) of weights: (sum w)^2 / sum w^2; 0 without any."""
    array = np.asarray(weight, dtype=np.float64)
    square = float((array**2).sum())
    return float(array.sum()) ** 2 / square if square > 0 else 0.0


class PairedDifference(NamedTuple):
    """Difference of two means over the same targets, in the unit of their numerators."""

    mean: float
    p: float  # of the sign-flip test over units
    units: tuple[bytes, bytes]  # differences and weights of the units that count

    @property
    def significant(self) -> bool:
        """True if p is below 0.05."""
        return self.p < SIGNIFICANT

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval that inverts the test: without 0 exactly if p < 0.05; None: unbounded.

        It is unbounded with fewer than six units.
        """
        return _test_interval(*self.units)


def paired_difference(
    a: ArrayLike, b: ArrayLike, denominator: ArrayLike
) -> PairedDifference | None:
    """Return the difference a - b of two means, and test its sum under random signs of the units.

    Numerators ``a`` and ``b`` [U], ``denominator`` [U]: the weight of the units; None where that is 0 in all of them.
    The test takes all 2^U signs up to EXACT_UNITS units, else FLIPS random ones and the observed one. Units without a
    difference and a weight do not matter; p is 1 without any other unit.
    """
    gap, weight = (
        beyond_rounding(as_sums("a", a), as_sums("b", b)),
        as_sums("denominator", denominator),
    )
    require_shape("denominator", weight, gap.shape)
    mean = ratio(gap.sum(), weight.sum())
    if mean is None:
        return None
    counted = (gap != 0) | (weight != 0)
    units = gap[counted].tobytes(), weight[counted].tobytes()
    return PairedDifference(mean, _chance(units[0]), units)


@dataclass(frozen=True, eq=False)
class UnitSums:
    """Sums of one agent over the targets of each unit, on one subset."""

    samples: int  # k, per object
    weight: Floats  # [U] of the targets
    error: Floats  # [U] m, weighted bADE
    effective_objects: float

    def minus(self, other: "UnitSums") -> PairedDifference | None:
        """Return bADE minus that of ``other`` on the same targets, metres; None without targets."""
        return paired_difference(self.error, other.error, self.weight)


def beyond_rounding(one: Floats, other: Floats) -> Floats:
    """Differences of two arrays, 0 within rounding.

    Sums of the same terms in another order, or means of other numbers of equal seeds, differ by rounding alone.
    """
    gap = one - other
    return np.where(
        np.abs(gap) <= ROUNDING * np.maximum(np.abs(one), np.abs(other)), 0.0, gap
    )


def ratio(top: float, bottom: float) -> float | None:
    """``top / bottom``; None unless the denominator is above 0."""
    return float(top / bottom) if bottom > 0 else None


def share_interval(part: ArrayLike, whole: ArrayLike) -> tuple[float, float] | None:
    """Percentile interval (95 %) of sum(part) / sum(whole) over resampled units, [U] each and of either sign.

    None with fewer than three units, or if the whole is not above 0 in nearly all resamples.
    """
    top, bottom = as_sums("part", part), as_sums("whole", whole)
    require_shape("whole", bottom, top.shape)
    if len(bottom) < LEAST_UNITS:
        return None
    counts = _resamples(len(bottom))
    total = counts @ bottom
    if (total <= 0).mean() > (1 - LEVEL) / 2:
        return None
    positive = total > 0
    low, high = np.quantile(
        (counts @ top)[positive] / total[positive], [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
    )
    return float(low), float(high)


@lru_cache(
    maxsize=8192
)  # a leaderboard needs a pair of agents for ranks and for differences
def _test_interval(difference: bytes, weight: bytes) -> tuple[float, float] | None:
    """Return the means m for which the differences minus m times the weights have p >= 0.05."""
    gap, share = np.frombuffer(difference), np.frombuffer(weight)
    if not gap.any():
        return (0.0, 0.0) if len(gap) >= RANKED_UNITS else None
    signs, observed = _flips(len(gap))
    low, high = _ends(gap, share, signs @ np.stack([gap, share], axis=1))
    # as many flips must hold a mean for its p to be 0.05 or more
    least = int(np.ceil(SIGNIFICANT * (len(low) + observed) - 1e-9)) - observed
    interval = (
        float(np.partition(low, least - 1)[least - 1]),
        float(np.partition(high, -least)[-least]),
    )
    return interval if np.isfinite(interval).all() else None


@lru_cache(maxsize=8192)
def _chance(difference: bytes) -> float:
    """The p of one difference in units that count."""
    return float(_chances(np.frombuffer(difference)[None])[0])


def significant_pairs(
    errors: Floats, weight: ArrayLike, pairs: NDArray[np.int64]
) -> Bools:
    """True where the differences of ``pairs`` [2, P] of rows of ``errors`` [A, U] are significant, many at once."""
    share = as_sums("weight", weight)
    require_shape("weight", share, (errors.shape[1],))
    # of the weight alone: a forged error without any must not change the flips of other pairs
    errors, starts = errors[:, share != 0], range(0, pairs.shape[1], _TOGETHER)
    chances = [
        _chances(beyond_rounding(*errors[pairs[:, i : i + _TOGETHER]])) for i in starts
    ]
    return (np.concatenate([np.zeros(0), *chances]) < SIGNIFICANT) & share.any()


def _chances(gap: Floats) -> Floats:
    """The p [P] of differences [P, U] in units that count."""
    signs, observed = _flips(gap.shape[1])
    slack = ROUNDING * np.abs(gap).sum(
        axis=1, keepdims=True
    )  # the same terms may be summed in another order
    beyond = np.abs(gap.sum(axis=1, keepdims=True)) - np.abs(gap @ signs.T)
    return np.asarray(
        ((beyond <= slack).sum(axis=1) + observed) / (len(signs) + observed)
    )


def _ends(gap: Floats, share: Floats, flipped: Floats) -> tuple[Floats, Floats]:
    """Means between which each flip is at least as extreme as what was observed: from [N], to [N].

    ``flipped`` [N, 2]: sums of differences and weights after each flip. They are inside where
    |A - m B| >= |D - m W|: between (D + A) / (W + B) and (D - A) / (W - B), which always include D / W.
    """
    total = np.array([gap.sum(), share.sum()])
    slack = ROUNDING * np.abs(np.stack([gap, share])).sum(
        axis=1
    )  # the same terms may be summed in another order
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([_end(total + flipped, slack), _end(total - flipped, slack)])
    unbounded = np.isnan(ends).any(axis=0)  # the observed signs, or all turned
    return np.where(unbounded, -np.inf, ends.min(axis=0)), np.where(
        unbounded, np.inf, ends.max(axis=0)
    )


def _end(sums: Floats, slack: Floats) -> Floats:
    difference, weight = np.where(np.abs(sums) <= slack, 0.0, sums).T
    return np.asarray(difference / weight)


def as_sums(name: str, values: ArrayLike) -> Floats:
    """Sums over the targets of each unit [U] as an array; raises ShapeError for another shape or a NaN."""
    array = np.asarray(values, dtype=np.float64)
    require_shape(name, array, (None,))
    require_finite(name, array)
    return array


@lru_cache(maxsize=8)
def _flips(units: int) -> tuple[Floats, int]:
    """All signs [2^U, U] and 0; of more than EXACT_UNITS units random ones and 1, the observed signs beside them."""
    if units > EXACT_UNITS:
        return _signs(units).astype(np.float64), 1
    return 1.0 - 2.0 * ((np.arange(1 << units)[:, None] >> np.arange(units)) & 1), 0


@lru_cache(
    maxsize=64
)  # a comparison of many agents uses the same signs again and again
def _signs(units: int) -> NDArray[np.int8]:
    """Random signs [FLIPS, U], as bytes since they are cached."""
    return (
        np.random.default_rng(_SEED)
        .choice([-1.0, 1.0], size=(FLIPS, units))
        .astype(np.int8)
    )


@lru_cache(maxsize=8)
def _resamples(units: int) -> Floats:
    """Number of times each unit occurs in each resample [RESAMPLES, U]."""
    rng = np.random.default_rng([_SEED, units])
    counts = rng.multinomial(units, np.full(units, 1.0 / units), size=RESAMPLES)
    return counts.astype(np.float64)
