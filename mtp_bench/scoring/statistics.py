"""Uncertainty: studentised intervals, sign-flip tests and intervals that invert them.

Units are recordings cut into blocks of at most 20 s. A weighted mean over targets is a
ratio of sums over units: ``numerator`` [U] and ``denominator`` [U], the weight of the
targets (docs/definitions, "Ranks").
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
_TAILS = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
MIN_UNITS = 3  # of an interval
# quantile of Student's t: no 95 % interval is wider than the 99 % interval of normal
# units
_WIDEST = 0.995
EXACT_UNITS = 14  # all sign flips up to here
FLIPS = 10_000  # random sign flips beyond
ROUNDING = 1e-12  # relative difference up to which two numbers count as equal
_SEED = 20_250_101
_BATCH = 64  # differences whose sums are flipped in one product


def bootstrap_interval(
    numerator: ArrayLike, denominator: ArrayLike
) -> tuple[float, float] | None:
    """Return the 95 % interval of sum(numerator) / sum(denominator) over units.

    A studentised bootstrap: the error of each resample's mean is taken in units of that
    resample's own standard error, so that the interval is wide enough for few and
    unequal units; the percentile interval is not (Efron and Tibshirani 1993, ch. 12).
    Units without weight (denominator 0) are left out; None with fewer than three
    others, since resamples of two units do not estimate an error. The resamples depend
    on the number of units only, so agents are compared on the same ones. If no sum is
    below 0, neither is the interval.
    """
    sums = as_sums("numerator", numerator)
    weight = as_sums("denominator", denominator)
    require_shape("numerator", sums, weight.shape)
    if (weight < 0).any():
        raise ShapeError(
            f"denominator reaches down to {weight.min()}, expected weights of 0 or more"
        )
    return _interval(sums[weight > 0].tobytes(), weight[weight > 0].tobytes())


# a leaderboard needs the difference of the same reference pair with every agent; bytes,
# as arrays cannot be keys of a cache
@lru_cache(maxsize=8192)
def _interval(numerator: bytes, denominator: bytes) -> tuple[float, float] | None:
    from scipy.special import stdtrit  # scipy.stats takes seconds to import

    sums = np.frombuffer(numerator)
    weight = np.frombuffer(denominator)
    units = len(weight)
    if units < MIN_UNITS:
        return None
    mean, error = _mean_and_error(np.ones((1, units)), sums, weight)
    means, errors = _mean_and_error(_resamples(units), sums, weight)
    # not those that drew one unit again and again
    usable = errors > 1e-9 * max(float(error[0]), 1e-300)
    if error[0] == 0 or not usable.any():
        return float(mean[0]), float(mean[0])
    t_values = (means[usable] - mean[0]) / errors[usable]
    # largest half-width in standard errors: resamples of few units estimate it badly
    limit = float(stdtrit(units - 1, _WIDEST))
    low, high = np.clip(np.quantile(t_values, _TAILS), -limit, limit)
    lower_end = float(mean[0] - high * error[0])
    if sums.min() >= 0:
        lower_end = max(lower_end, 0.0)
    return lower_end, float(mean[0] - low * error[0])


def _mean_and_error(
    counts: Floats, sums: Floats, weight: Floats
) -> tuple[Floats, Floats]:
    """Return mean and standard error [B] of resamples.

    A resample has each unit ``counts`` [B, U] times.
    """
    total_weight = counts @ weight
    mean = (counts @ sums) / total_weight
    # unit by unit: in a difference of sums of squares, rounding gives an error to
    # resamples of one unit alone
    square = (counts * (sums - mean[:, None] * weight) ** 2).sum(axis=1)
    units = counts.sum(axis=1)
    error = np.sqrt(square * units / np.maximum(units - 1.0, 1.0)) / total_weight
    return mean, error


def effective_number(weight: ArrayLike) -> float:
    """Return the effective sample size (Kish 1965): (sum w)^2 / sum w^2.

    It is 0 without any weight.
    """
    array = np.asarray(weight, dtype=np.float64)
    square = float((array**2).sum())
    return float(array.sum()) ** 2 / square if square > 0 else 0.0


class PairedDifference(NamedTuple):
    """Difference of two means over the same targets, in their numerators' unit."""

    mean: float
    p: float  # p-value of the sign-flip test over units
    units: tuple[bytes, bytes]  # differences and weights of the units that count

    @property
    def significant(self) -> bool:
        """True if p is below 0.05."""
        return self.p < SIGNIFICANT

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval that inverts the test: without 0 exactly if p < 0.05.

        None: it is unbounded, as with fewer than six units.
        """
        return _test_interval(*self.units)


Numbers = tuple[float | None, tuple[float, float] | None, float | None]


def numbers_of(difference: PairedDifference | None) -> Numbers:
    """Return mean, interval and p of a difference.

    None for each without one.
    """
    if difference is None:
        return None, None, None
    return difference.mean, difference.interval, difference.p


def paired_difference(
    a: ArrayLike, b: ArrayLike, denominator: ArrayLike
) -> PairedDifference | None:
    """Return the difference a - b of two means, and test its sum.

    Numerators ``a`` and ``b`` [U], ``denominator`` [U]: the weight of the units; None
    where that is 0 in all of them. The sign-flip test takes all 2^U signs of the units
    up to EXACT_UNITS units, else FLIPS random ones and the observed one. Units without
    a difference and a weight do not matter; p is 1 without any other unit.
    """
    difference = beyond_rounding(as_sums("a", a), as_sums("b", b))
    weight = as_sums("denominator", denominator)
    require_shape("denominator", weight, difference.shape)
    mean = ratio(difference.sum(), weight.sum())
    if mean is None:
        return None
    counted = (difference != 0) | (weight != 0)
    units = difference[counted].tobytes(), weight[counted].tobytes()
    return PairedDifference(mean, _p_value(units[0]), units)


@dataclass(frozen=True, eq=False)
class UnitSums:
    """Sums of one agent over the targets of each unit, on one subset."""

    samples: int  # k, per object
    weight: Floats  # [U] of the targets
    error: Floats  # [U] m, weighted bADE
    effective_objects: float

    def minus(self, subtracted: "UnitSums") -> PairedDifference | None:
        """Return bADE minus that of ``subtracted`` on the same targets, metres.

        None without targets.
        """
        return paired_difference(self.error, subtracted.error, self.weight)


def beyond_rounding(a: Floats, b: Floats) -> Floats:
    """Return the differences a - b, 0 within rounding.

    Sums of the same terms in another order, or means of other numbers of equal seeds,
    differ by rounding alone.
    """
    difference = a - b
    slack = ROUNDING * np.maximum(np.abs(a), np.abs(b))
    return np.where(np.abs(difference) <= slack, 0.0, difference)


def ratio(numerator: float, denominator: float) -> float | None:
    """Return numerator / denominator.

    None unless the denominator is above 0.
    """
    return float(numerator / denominator) if denominator > 0 else None


def share_interval(part: ArrayLike, total: ArrayLike) -> tuple[float, float] | None:
    """Return the percentile interval (95 %) of sum(part) / sum(total) over units.

    ``part`` and ``total`` [U] may be of either sign. None with fewer than three units,
    or if the total is not above 0 in nearly all resamples.
    """
    part_sums = as_sums("part", part)
    total_sums = as_sums("total", total)
    require_shape("total", total_sums, part_sums.shape)
    if len(total_sums) < MIN_UNITS:
        return None
    counts = _resamples(len(total_sums))
    total = counts @ total_sums
    if (total <= 0).mean() > (1 - LEVEL) / 2:
        return None
    positive = total > 0
    shares = (counts @ part_sums)[positive] / total[positive]
    low, high = np.quantile(shares, _TAILS)
    return float(low), float(high)


# a leaderboard needs a pair of agents for ranks and for differences
@lru_cache(maxsize=8192)
def _test_interval(difference: bytes, weight: bytes) -> tuple[float, float] | None:
    """Return the means m at which differences minus m times weights have p >= 0.05."""
    unit_difference = np.frombuffer(difference)
    unit_weight = np.frombuffer(weight)
    units = len(unit_difference)
    if not unit_difference.any():
        return (0.0, 0.0) if units >= RANKED_UNITS else None
    signs, observed = _flips(units)
    flipped = signs @ np.stack([unit_difference, unit_weight], axis=1)
    low, high = _flip_ends(unit_difference, unit_weight, flipped)
    # as many flips must hold a mean for its p to be 0.05 or more; 1e-9: rounding
    count = int(np.ceil(SIGNIFICANT * (len(low) + observed) - 1e-9)) - observed
    low_end = float(np.partition(low, count - 1)[count - 1])
    high_end = float(np.partition(high, -count)[-count])
    bounded = np.isfinite([low_end, high_end]).all()
    return (low_end, high_end) if bounded else None


@lru_cache(maxsize=8192)
def _p_value(difference: bytes) -> float:
    return float(_p_values(np.frombuffer(difference)[None])[0])


def significant_pairs(
    errors: Floats, weight: ArrayLike, pairs: NDArray[np.int64]
) -> Bools:
    """Return True [P] where the two agents of a pair differ significantly.

    ``errors`` [A, U] of agents, ``weight`` [U], ``pairs`` [2, P] of rows of ``errors``.
    """
    unit_weight = as_sums("weight", weight)
    require_shape("weight", unit_weight, (errors.shape[1],))
    # a forged error without any weight must not change the flips of other pairs
    errors = errors[:, unit_weight != 0]
    p_values: list[Floats] = [np.zeros(0)]
    for start in range(0, pairs.shape[1], _BATCH):
        first, second = errors[pairs[:, start : start + _BATCH]]
        p_values.append(_p_values(beyond_rounding(first, second)))
    return (np.concatenate(p_values) < SIGNIFICANT) & unit_weight.any()


def _p_values(difference: Floats) -> Floats:
    """Return the p [P] of differences [P, U] in units that count."""
    signs, observed = _flips(difference.shape[1])
    # the same terms may be summed in another order
    slack = ROUNDING * np.abs(difference).sum(axis=1, keepdims=True)
    total = np.abs(difference.sum(axis=1, keepdims=True))
    as_extreme = total - np.abs(difference @ signs.T) <= slack
    return np.asarray((as_extreme.sum(axis=1) + observed) / (len(signs) + observed))


def _flip_ends(
    difference: Floats, weight: Floats, flipped: Floats
) -> tuple[Floats, Floats]:
    """Return the means [N], [N] between which each flip is as extreme as observed.

    ``flipped`` [N, 2]: sums of differences and weights after each flip. Means m are
    inside where |A - m B| >= |D - m W|: between (D + A) / (W + B) and
    (D - A) / (W - B), which always include D / W.
    """
    total = np.array([difference.sum(), weight.sum()])
    # the same terms may be summed in another order
    slack = ROUNDING * np.abs(np.stack([difference, weight])).sum(axis=1)
    quotients = []
    for sums in (total + flipped, total - flipped):
        numerator, denominator = np.where(np.abs(sums) <= slack, 0.0, sums).T
        with np.errstate(divide="ignore", invalid="ignore"):
            quotients.append(numerator / denominator)
    ends = np.stack(quotients)
    unbounded = np.isnan(ends).any(axis=0)  # the observed signs, or all turned
    low = np.where(unbounded, -np.inf, ends.min(axis=0))
    return low, np.where(unbounded, np.inf, ends.max(axis=0))


def as_sums(name: str, values: ArrayLike) -> Floats:
    """Return sums over the targets of each unit [U] as an array.

    Raises ShapeError for another shape or a NaN.
    """
    array = np.asarray(values, dtype=np.float64)
    require_shape(name, array, (None,))
    require_finite(name, array)
    return array


# a comparison of many agents uses the same signs again and again
@lru_cache(maxsize=8)
def _flips(units: int) -> tuple[Floats, int]:
    """Return the signs [N, U] of the test, and the number of observed ones beside them.

    All 2^U signs and 0; of more than EXACT_UNITS units random ones and 1.
    """
    if units > EXACT_UNITS:
        rng = np.random.default_rng(_SEED)
        return rng.choice([-1.0, 1.0], size=(FLIPS, units)), 1
    # bit u of a flip's number is the sign of unit u
    return 1.0 - 2.0 * ((np.arange(1 << units)[:, None] >> np.arange(units)) & 1), 0


@lru_cache(maxsize=8)
def _resamples(units: int) -> Floats:
    """Return how often each unit occurs in each resample [RESAMPLES, U]."""
    rng = np.random.default_rng([_SEED, units])
    counts = rng.multinomial(units, np.full(units, 1.0 / units), size=RESAMPLES)
    return counts.astype(np.float64)
