"""Units, significance, and conditions of a rank."""

import functools
import itertools
import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
from scipy.stats import t as student

from mtp_bench.cards import Card
from mtp_bench.core import Floats, Ints, Scene

from .targets import Target

RANKED = ("all", "ids", "reacquired")
RESAMPLES, FLIPS = 2000, 10_000
Drawn = Callable[[int], Any]  # for n units: indices [RESAMPLES, n] of resamples, or signs [FLIPS, n]
Interval = tuple[float, float]


def drawn_units(n: int) -> Ints:
    """Reading: the protocol names no stream of random numbers; this one, or that of the scorer it is compared with."""
    return np.random.default_rng(0).integers(0, n, (RESAMPLES, n))


def drawn_signs(n: int) -> Floats:
    """Signs of another stream."""
    return np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, n))


def units_of(scenes: Sequence[Scene], targets: Sequence[Target], card: Card) -> list[tuple[int, int]]:
    """Scene and block of each target."""
    units = []
    for target in targets:
        frames = scenes[target.scene].frames
        units.append((target.scene, target.t * blocks_of(frames, card.task.rate) // frames))
    return units


def blocks_of(frames: int, rate: float) -> int:
    """Blocks of equal length that a scene is cut into, as few as possible.

    Reading: a scene of nuScenes, which "is one unit", lasts up to 20.5 s: a second beyond the blocks makes no new one.
    """
    return max(1, math.ceil(round((frames / rate - 1) / 20, 9)))


def sums_of(keys: Sequence[Hashable], values: Floats) -> list[float]:
    """Sum of the values [n] of each key."""
    sums: dict[Hashable, float] = {}
    for key, value in zip(keys, values, strict=True):
        sums[key] = sums.get(key, 0.0) + float(value)
    return list(sums.values())


def effective(weights: Sequence[float]) -> float:
    """(sum of weights)^2 / sum of squares."""
    squares = sum(w * w for w in weights)
    return sum(weights) ** 2 / squares if squares > 0 else 0.0


@functools.lru_cache(maxsize=4)
def flips_of(n: int, signs: Drawn = drawn_signs) -> Floats:
    """Sign patterns of n units, of which the first is that of the data.

    Reading: beyond 14 units the drawn ``signs``, and the data as one more.
    """
    if n <= 14:
        return np.array(list(itertools.product((1.0, -1.0), repeat=n)))
    return np.concatenate([np.ones((1, n)), signs(n)])


def sign_flip(differences: Floats, weights: Floats, signs: Drawn = drawn_signs, null: float = 0.0) -> float:
    """Two-sided p of the ``null``: share of the flips whose sum is at least as far from 0 as that of the data.

    Reading: units are those with weight, also where their difference is 0.
    """
    d = (differences - null * weights)[weights > 0]
    return float(np.mean(np.abs(flips_of(len(d), signs) @ d) >= abs(d.sum()) * (1 - 1e-12)))


def inverted(differences: Floats, weights: Floats, signs: Drawn = drawn_signs) -> Interval | None:
    """95 % interval of a paired difference: all theta with p(theta) >= .05.

    A flip does not reject theta between its two ends, which lie on either side of D/W; a flip of all units or none
    rejects nothing. So p(theta) is the share of flips whose ends have theta between them.
    """
    d, w = differences[weights > 0], weights[weights > 0]
    if len(d) < 6:
        return None
    flips = flips_of(len(d), signs)
    kept = math.ceil(round(0.05 * len(flips), 9))  # so many flips at least must not reject
    some = flips[np.abs(flips.sum(axis=1)) < len(d)]
    a, b = some @ d, some @ w
    ends = np.sort([(d.sum() + a) / (w.sum() + b), (d.sum() - a) / (w.sum() - b)], axis=0)
    kept -= len(flips) - len(some)
    return float(np.sort(ends[0])[kept - 1]), float(np.sort(ends[1])[-kept])


def studentised(above: Floats, below: Floats, resamples: Drawn = drawn_units) -> Interval | None:
    """95 % interval of sum(``above``) / sum(``below``), sums over units [n], from resamples with errors of their own.

    Reading: units without weight do not enter, with budgets they carry no cost; below three units there is none. The
    standard error of a ratio is that of its linear part; a resample without one, all its units being alike, says
    nothing. No end is farther away than Student's t leaves one time in a hundred, with n - 1 degrees of freedom.
    """
    above, below = above[below > 0], below[below > 0]
    n = len(below)
    if n < 3:
        return None
    (ratio,), (error,) = _ratios(above[None], below[None])
    drawn = resamples(n)
    again, spread = _ratios(above[drawn], below[drawn])
    t = [(r - ratio) / s for r, s in zip(again, spread, strict=True) if s > 1e-9 * error]
    if error == 0 or not t:
        return ratio, ratio
    most = student.ppf(0.995, n - 1)
    low, high = (min(max(q, -most), most) for q in np.quantile(t, [0.025, 0.975]))
    return float(ratio - high * error), float(ratio - low * error)


def _ratios(above: Floats, below: Floats) -> tuple[list[float], list[float]]:
    """Of the units of each row [B, n] sum over sum, and its standard error."""
    n, ratio = above.shape[1], above.sum(axis=1) / below.sum(axis=1)
    squares = ((above - ratio[:, None] * below) ** 2).sum(axis=1)
    return ratio.tolist(), (np.sqrt(n / (n - 1) * squares) / below.sum(axis=1)).tolist()


def of_shares(part: Floats, whole: Floats, resamples: Drawn = drawn_units) -> Interval | None:
    """95 % interval of a share of the gap, sum(``part``) / sum(``whole``), sums over units [n].

    Reading: "intervals are studentised" holds for means of errors. Here the denominator is measured too, and the
    standard error of such a ratio is poor (percentiles hold the share as often): the interval is one of percentiles,
    over all units, and there is none where the denominator is not above 0 in nearly every resample.
    """
    if len(part) < 2:
        return None
    drawn = resamples(len(part))
    top, bottom = part[drawn].sum(axis=1), whole[drawn].sum(axis=1)
    if (bottom <= 0).mean() > 0.025:
        return None
    low, high = np.quantile(top[bottom > 0] / bottom[bottom > 0], [0.025, 0.975])
    return float(low), float(high)


def why_unranked(subset: str, weights: Floats, units: Sequence[Hashable], owners: Sequence[Hashable]) -> str:
    """Reason for which a subset has no ranks; empty where it has.

    Reading: "a subset" is "all" too, but for the share of one unit, which speaks of event weights.
    """
    if subset not in RANKED:
        return "shown, not ranked"
    of_units = sums_of(units, weights)
    if effective(sums_of(owners, weights)) < 20:
        return "too few objects"
    if effective(of_units) < 6:
        return "too few recordings to rank"
    if subset != "all" and max(of_units) > 0.25 * sum(of_units):
        return "one unit is more than a quarter"
    return ""


def guarded(worse: float, p: float) -> bool:
    """True if an agent has no rank on event subsets: on "all" it is worse than an STP by this share of its error."""
    return worse > 0.05 or (worse > 0.01 and p < 0.05)
