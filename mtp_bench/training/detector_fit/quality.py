"""Fit of the quality of detections.

Mean and scores are fitted by maximum likelihood, memory and sharing by simulation.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import ndtri

from ...core import Bools, Floats, Ints
from ...detector import (
    ClassNoise,
    Draws,
    Grid,
    Lapses,
    Neighbours,
    Quality,
    random_quality,
    skewed_cdf,
    skewed_density,
)
from .samples import ObjectSamples

NEIGHBOUR_LENGTH_M = 20.0  # objects farther apart share no noise
# of the scores below the cuts
_SHARES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995)
_BEST_QUALITY = 1.5  # of the highest score, above the last cut
_LAPSE_SHARES = (0.3, 0.5, 0.7)  # candidate shares of the variance
_LAGS = (1, 3, 8)  # frames
_BANDS_M = ((0.0, 5.0), (5.0, 10.0))  # between neighbours
# share of the hits below the second score threshold at which misses are compared
_SECOND_SHARE = 0.15
_MIN_PAIRS = 60  # for a correlation
_QUALITY_GROUPS = 10  # of equal size, by mean quality
_SEEDS = 8  # simulations per set of parameters
_START = np.array([1.0, 0.0, 1.0, -0.5, 0.5, 1.0, 0.0])  # log-odds, see `_with_memory`
_SCALE = 0.03  # of all compared figures, which are correlations
_MIN_CUT_STEP = 1e-4  # between two cuts
# inverse variance of a weight around 0; keeps the weight of a feature that never occurs
# at 0
_RIDGE = 1.0
_MIN_CHANCE = 1e-12
_SLOPE_STEP = 0.25  # of every unknown: simulated figures are not smooth
# pull towards the start, for unknowns that the figures do not determine
_PRIOR = 0.15
_MAX_UNKNOWN = 4.5  # unknowns are log-odds or logarithms
_SEARCH_ROUNDS = 8


def fit_quality(objects: ObjectSamples, floor: float) -> Quality:
    """Fit the quality whose correlations are nearest to the real ones.

    It is the best over candidate shares of lapses.
    """
    has_scores = float(np.ptp(objects.score[objects.hit])) > 0
    candidates = []
    for share in _LAPSE_SHARES if has_scores else _LAPSE_SHARES[:1]:
        quality = _margins(objects, floor, share)
        simulation = _QualitySimulation(objects, quality)
        real = simulation.correlations(objects.hit, objects.score)
        scale = np.full(len(real), _SCALE)
        unknown = nearest_parameters(simulation.simulated, real, scale, _START)
        difference = (simulation.simulated(unknown) - real)[np.isfinite(real)] / _SCALE
        fitted = _with_memory(quality, unknown)
        candidates.append((float(difference @ difference), fitted))
    return min(candidates, key=lambda candidate: candidate[0])[1]


def random_part(objects: ObjectSamples, quality: Quality) -> Floats:
    """Return the random part ``[R]`` of qualities, from the scores.

    It is the quality of the score less the mean quality of the box; NaN where
    undetected.
    """
    value = np.full(len(objects.hit), np.nan)
    score = objects.score[objects.hit]
    value[objects.hit] = np.interp(score, quality.score, quality.latent)
    return np.asarray(value - objects.feature @ np.array(quality.location))


def _margins(objects: ObjectSamples, floor: float, lapse_share: float) -> Quality:
    """Return a quality with fitted mean and scores.

    A miss is the lowest level. The values of the memory are placeholders.
    """
    score = objects.score[objects.hit]
    cuts = np.unique(np.append(np.quantile(score, _SHARES), floor))
    cuts = cuts[cuts >= floor]
    if score.min() == score.max():
        cuts = cuts[:1]  # without scores only the floor
    # number of cuts that a box' quality reaches: 0 for a miss, at least 1 for a hit
    level = np.zeros(len(objects.hit), dtype=np.int64)
    level[objects.hit] = np.maximum(np.searchsorted(cuts, score, side="right"), 1)
    location, latent = fit_ordered_levels(
        objects.feature, level, len(cuts) + 1, lapse_share
    )
    return Quality(
        bias=0.5,
        ar=0.3,
        phi=0.7,
        white=0.2,
        location=rounded(location),
        lapses=Lapses(share=lapse_share, bias=0.5, phi=0.7, shared=0.5),
        latent=rounded(np.append(latent, latent[-1] + _BEST_QUALITY)),
        score=rounded(np.append(cuts, score.max())),
        floor=floor,
    )


def rounded(values: Floats) -> tuple[float, ...]:
    """Round numbers to the four digits that a profile has."""
    return tuple(round(float(value), 4) for value in values)


def _with_memory(quality: Quality, unknown: Floats) -> Quality:
    """Return the quality with the memory given by log-odds ``unknown`` ``[7]``."""
    lasting, constant, phi, shared, *lapse = map(from_log_odds, unknown.tolist())
    bias, lapse_phi, lapse_shared = rounded(np.array(lapse))
    lapses = quality.lapses.model_copy(
        update={"bias": bias, "phi": lapse_phi, "shared": lapse_shared}
    )
    memory = memory_of(lasting, constant, phi)
    return quality.model_copy(
        update={**memory, "shared": round(shared, 4), "lapses": lapses}
    )


def memory_of(lasting: float, constant: float, phi: float) -> dict[str, float]:
    """Return the fields of `Shares`.

    ``lasting``: share of the variance; ``constant``: share of the lasting share.
    """
    bias = round(lasting * constant, 4)
    ar = round(lasting * (1 - constant), 4)
    return {
        "bias": bias,
        "ar": ar,
        "phi": round(phi, 4),
        "white": round(1.0 - bias - ar, 4),
    }


class _QualitySimulation:
    """True objects of a class over all scenes, joined to one long scene.

    Qualities can be drawn in it.
    """

    def __init__(self, objects: ObjectSamples, quality: Quality) -> None:
        """Take the fitted margins of ``quality``."""
        ids, column = np.unique(objects.object, return_inverse=True)
        self.grid = Grid(
            int(objects.frame.max(initial=0)) + 1,
            ids,
            objects.frame,
            column,
            (),  # the noise, which `simulated` sets for all objects
            np.zeros(len(ids), dtype=np.int64),
            1.0,  # frame periods of the profile per frame
        )
        self.neighbours = Neighbours.within(
            NEIGHBOUR_LENGTH_M, objects.place, objects.moments(), objects.object
        )
        row = self.neighbours.row
        neighbour = self.neighbours.other
        distance_m = np.hypot(*(objects.place[row] - objects.place[neighbour]).T)
        # rows of one object by `_LAGS`, then of neighbours by `_BANDS_M`
        self.pairs = [objects.pairs(lag) for lag in _LAGS]
        for low, high in _BANDS_M:
            in_band = (distance_m > low) & (distance_m <= high) & (row < neighbour)
            self.pairs.append((row[in_band], neighbour[in_band]))
        hit_score = objects.score[objects.hit]
        self.second_threshold = float(np.quantile(hit_score, _SECOND_SHARE))
        self.location = objects.feature @ np.array(quality.location)
        self.quality = quality

    def simulated(self, unknown: Floats) -> Floats:
        """Return mean `correlations` over seeds with the memory of ``unknown``."""
        quality = _with_memory(self.quality, unknown)
        grid = replace(self.grid, noise=(ClassNoise.model_construct(quality=quality),))
        results = []
        for seed in range(_SEEDS):
            value = self.location + random_quality(grid, self.neighbours, Draws(seed))
            score = np.interp(value, quality.latent, quality.score)
            results.append(self.correlations(value >= quality.latent[0], score))
        return np.asarray(np.nan_to_num(results).mean(axis=0))

    def correlations(self, hit: Bools, score: Floats) -> Floats:
        """Return correlations of qualities, of misses and of weak scores.

        They are over frames and between neighbours. A score is weak below the second
        threshold. ``hit`` [R]; ``score`` [R], NaN where undetected.
        """
        quality = np.interp(
            np.nan_to_num(score), self.quality.score, self.quality.latent
        )
        value = quality - self.location
        is_strong = np.nan_to_num(score, nan=-np.inf) >= self.second_threshold
        missed = self._residual(~hit)
        weak = self._residual(~(hit & is_strong))
        result = []
        for one, two in self.pairs:
            hit_twice = hit[one] & hit[two]
            result += [
                _correlation(value, one[hit_twice], two[hit_twice]),
                _correlation(missed, one, two),
                _correlation(weak, one, two),
            ]
        return np.array(result)

    def _residual(self, miss: Bools) -> Floats:
        """Return misses ``[R]`` less their mean at similar mean quality."""
        ends = np.linspace(0.0, 1.0, _QUALITY_GROUPS + 1)[1:-1]
        group = np.searchsorted(np.quantile(self.location, ends), self.location)
        count = np.bincount(group, minlength=_QUALITY_GROUPS)
        mean = np.bincount(group, miss, _QUALITY_GROUPS) / np.maximum(count, 1)
        return np.asarray(miss - mean[group])


def _correlation(value: Floats, one: Ints, two: Ints) -> float:
    """Return the correlation over pairs of rows, each in both orders."""
    if len(one) < _MIN_PAIRS:
        return float("nan")
    first = value[one]
    second = value[two]
    # the same mean and variance for both, as each pair counts in both orders
    mean = 0.5 * (first.mean() + second.mean())
    first = first - mean
    second = second - mean
    square = first @ first + second @ second
    if square > 0:
        return float(2.0 * (first @ second) / square)
    return 0.0


def fit_ordered_levels(
    feature: Floats, level: Ints, levels: int, lapse_share: float
) -> tuple[Floats, Floats]:
    """Fit weights ``[n]`` of a mean, and cuts ``[levels - 1]``.

    The fit is by maximum likelihood. The mean is over ``feature`` ``[R, n]``.
    ``level`` ``[R]`` 0, 1, ... is the number of cuts below a number with this mean and
    variance 1, whose lower tail has the exponential share ``lapse_share``; the first
    cut is 0.
    """
    share = np.cumsum(np.bincount(level, minlength=levels))[:-1] / len(level)
    start = ndtri(np.clip(share, 1e-3, 1 - 1e-3))
    gaps = np.log(np.maximum(np.diff(start), 1e-2))
    weight = np.zeros(feature.shape[1])
    weight[0] = -start[0]
    fitted = minimize(
        _level_loss,
        np.concatenate([weight, gaps]),
        (feature, level, lapse_share),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 1000},
    )
    weight, gaps = np.split(fitted.x, [feature.shape[1]])
    return weight, np.append(0.0, _cuts(gaps))


def _cuts(gaps: Floats) -> Floats:
    """Return the cuts after the first, which is 0, from logarithms of gaps."""
    return np.cumsum(np.exp(gaps) + _MIN_CUT_STEP)


def _level_loss(
    unknown: Floats, feature: Floats, level: Ints, lapse_share: float
) -> tuple[float, Floats]:
    """Return the mean negative log-likelihood and its gradient.

    ``unknown``: weights of the features, and logarithms of the gaps between cuts.
    """
    weight, gaps = np.split(unknown, [feature.shape[1]])
    # the outermost levels have no limit: +-1e3 stands for +-inf
    cuts = np.concatenate([[-1e3, 0.0], _cuts(gaps), [1e3]])
    mean = feature @ weight
    low = mean - cuts[level]
    high = mean - cuts[level + 1]
    # of the mirrored number, with the exponential tail above
    chance = skewed_cdf(low, lapse_share) - skewed_cdf(high, lapse_share)
    chance = np.maximum(chance, _MIN_CHANCE)
    at_low = skewed_density(low, lapse_share) / chance
    at_high = skewed_density(high, lapse_share) / chance
    weight_slope = feature.T @ (at_high - at_low)
    low_slope = np.bincount(level, at_low, len(cuts))
    cut_slope = low_slope - np.bincount(level + 1, at_high, len(cuts))
    # a gap moves all cuts above it
    gap_slope = np.cumsum(cut_slope[2:-1][::-1])[::-1] * np.exp(gaps)
    penalty = 0.5 * _RIDGE * float(weight[1:] @ weight[1:])
    weight_slope[1:] += _RIDGE * weight[1:]
    slope = np.concatenate([weight_slope, gap_slope])
    return (penalty - float(np.log(chance).sum())) / len(level), slope / len(level)


def nearest_parameters(
    figures: Callable[[Floats], Floats], real: Floats, scale: Floats, start: Floats
) -> Floats:
    """Return unknowns whose ``figures`` are nearest to the ``real`` ones.

    Only finite real figures count. Differences are in units of ``scale``; ``start``:
    first unknowns.
    """
    finite = np.isfinite(real)

    def loss(unknown: Floats) -> Floats:
        difference = (np.nan_to_num(figures(unknown)) - real)[finite] / scale[finite]
        return np.concatenate([difference, _PRIOR * (unknown - start)])

    def slope(unknown: Floats) -> Floats:
        current = loss(unknown)
        steps = _SLOPE_STEP * np.eye(len(start))
        changes = [loss(unknown + step) - current for step in steps]
        return np.stack(changes, axis=-1) / _SLOPE_STEP

    bounds = (-_MAX_UNKNOWN, _MAX_UNKNOWN)
    fitted = least_squares(
        loss, start, slope, bounds, "dogbox", max_nfev=_SEARCH_ROUNDS
    )
    return np.asarray(fitted.x)


def from_log_odds(log_odds: float) -> float:
    """Return the share with these log-odds."""
    return float(1.0 / (1.0 + np.exp(-log_odds)))
