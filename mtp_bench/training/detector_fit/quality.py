"""Fit of the quality: mean and scores by maximum likelihood, memory and sharing by simulation."""

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

NEIGHBOUR_LENGTH = 20.0  # m; objects farther apart share no noise
_SHARES = (
    0.05,
    0.1,
    0.2,
    0.3,
    0.4,
    0.5,
    0.6,
    0.7,
    0.8,
    0.9,
    0.95,
    0.98,
    0.995,
)  # of the scores below the cuts
_BEST = 1.5  # quality of the highest score above the last cut
_LAPSES = (0.3, 0.5, 0.7)  # candidate shares of the variance
_LAGS = (1, 3, 8)  # frames
_BANDS = ((0.0, 5.0), (5.0, 10.0))  # m between neighbours
_SECOND = 0.15  # share of the hits below the second score threshold at which misses are compared
_FEW = 60  # least pairs for a correlation
_SEEDS = 8
_START = np.array([1.0, 0.0, 1.0, -0.5, 0.5, 1.0, 0.0])
_SCALE = 0.03  # of all compared figures, which are correlations
_LEAST_STEP = 1e-4  # between two cuts
_RIDGE = 1.0  # inverse variance of a weight around 0; keeps the weight of a feature that never occurs at 0
_TINY = 1e-12
_STEP = 0.25  # of every unknown, for slopes: simulated figures are not smooth
_PRIOR = 0.15  # pull towards the start, for unknowns that the figures do not determine
_FARTHEST = 4.5  # unknowns are log-odds or logarithms
_SEARCH_ROUNDS = 8


def fit_quality(objects: ObjectSamples, floor: float) -> Quality:
    """Fit the quality whose correlations are nearest to the real ones, over candidate shares of lapses."""
    scored = float(np.ptp(objects.score[objects.hit])) > 0
    best = None
    least = np.inf
    for share in _LAPSES:
        quality = _margins(objects, floor, share)
        simulation = _QualitySimulation(objects, quality)
        real = simulation.correlations(objects.hit, objects.score)
        unknown = nearest_parameters(
            simulation.simulated, real, np.full(len(real), _SCALE), _START
        )
        difference = (simulation.simulated(unknown) - real)[np.isfinite(real)] / _SCALE
        if float(difference @ difference) < least:
            best = _with_memory(quality, unknown)
            least = float(difference @ difference)
        if not scored:
            break
    assert best is not None
    return best


def random_part(objects: ObjectSamples, quality: Quality) -> Floats:
    """Random part of the quality that the scores show ``[R]``, NaN where undetected."""
    value = np.full(len(objects.hit), np.nan)
    value[objects.hit] = np.interp(
        objects.score[objects.hit], quality.score, quality.latent
    )
    return np.asarray(value - objects.feature @ np.array(quality.location))


def _margins(objects: ObjectSamples, floor: float, lapses: float) -> Quality:
    """Quality with fitted mean and scores, where a miss is the lowest level; the memory is a placeholder."""
    score = objects.score[objects.hit]
    cut = np.unique(np.append(np.quantile(score, _SHARES), floor))
    cut = cut[cut >= floor][
        : 1 if score.min() == score.max() else None
    ]  # without scores only the floor
    level = np.zeros(len(objects.hit), dtype=np.int64)
    level[objects.hit] = np.maximum(np.searchsorted(cut, score, side="right"), 1)
    weight, latent = fit_ordered_levels(objects.feature, level, len(cut) + 1, lapses)
    return Quality(
        bias=0.5,
        ar=0.3,
        phi=0.7,
        white=0.2,
        location=rounded(weight),
        lapses=Lapses(share=lapses, bias=0.5, phi=0.7, shared=0.5),
        latent=rounded(np.append(latent, latent[-1] + _BEST)),
        score=rounded(np.append(cut, score.max())),
        floor=floor,
    )


def rounded(values: Floats) -> tuple[float, ...]:
    """Round numbers to the four digits that a profile has."""
    return tuple(round(float(value), 4) for value in values)


def _with_memory(quality: Quality, unknown: Floats) -> Quality:
    """The quality with the memory given by log-odds ``unknown`` ``[7]``."""
    lasting, constant, phi, shared, *lapse = (
        from_log_odds(float(value)) for value in unknown
    )
    names = ("bias", "phi", "shared")
    lapses = quality.lapses.model_copy(
        update=dict(zip(names, rounded(np.array(lapse)), strict=True))
    )
    update = {
        **memory_of(lasting, constant, phi),
        "shared": round(shared, 4),
        "lapses": lapses,
    }
    return quality.model_copy(update=update)


def memory_of(lasting: float, constant: float, phi: float) -> dict[str, float]:
    """Fields of `Shares` from the lasting share of the variance, and the constant share of that."""
    bias = round(lasting * constant, 4)
    ar = round(lasting * (1 - constant), 4)
    return {
        "bias": bias,
        "ar": ar,
        "phi": round(phi, 4),
        "white": round(1.0 - bias - ar, 4),
    }


class _QualitySimulation:
    """True objects of a class over all scenes, joined to one long scene in which qualities can be drawn."""

    def __init__(self, objects: ObjectSamples, quality: Quality) -> None:
        """``quality``: with fitted margins."""
        width = int(objects.frame.max(initial=0)) + 1
        ids, column = np.unique(objects.object, return_inverse=True)
        self.grid = Grid(
            width,
            ids,
            objects.frame,
            column,
            (),
            np.zeros(len(ids), dtype=np.int64),
            1.0,
        )
        moment = objects.scene * width + objects.frame
        near = self.neighbours = Neighbours.within(
            NEIGHBOUR_LENGTH, objects.place, moment, objects.object
        )
        distance = np.hypot(*(objects.place[near.row] - objects.place[near.other]).T)
        bands = [
            (distance > low) & (distance <= high) & (near.row < near.other)
            for low, high in _BANDS
        ]
        # rows of one object by `_LAGS`, then of neighbours by `_BANDS`
        self.pairs = [
            *map(objects.pairs, _LAGS),
            *((near.row[band], near.other[band]) for band in bands),
        ]
        self.second_threshold = float(np.quantile(objects.score[objects.hit], _SECOND))
        self.location = objects.feature @ np.array(quality.location)
        self.quality = quality

    def simulated(self, unknown: Floats) -> Floats:
        """Mean `correlations` over seeds, with the memory given by log-odds."""
        quality = _with_memory(self.quality, unknown)
        grid = replace(self.grid, noise=(ClassNoise.model_construct(quality=quality),))
        results = []
        for seed in range(_SEEDS):
            value = self.location + random_quality(grid, self.neighbours, Draws(seed))
            score = np.interp(value, quality.latent, quality.score)
            results.append(self.correlations(value >= quality.latent[0], score))
        return np.asarray(np.nan_to_num(results).mean(axis=0))

    def correlations(self, hit: Bools, score: Floats) -> Floats:
        """Correlations of qualities and of misses, over frames and between neighbours.

        ``hit`` [R]; ``score`` [R], NaN where undetected.
        """
        value = (
            np.interp(np.nan_to_num(score), self.quality.score, self.quality.latent)
            - self.location
        )
        strong = hit & (np.nan_to_num(score, nan=-np.inf) >= self.second_threshold)
        missed = self._residual(~hit)
        weak = self._residual(~strong)
        result = []
        for one, other in self.pairs:
            both = hit[one] & hit[other]
            result.append(_correlation(value, one[both], other[both]))
            result += [_correlation(missed, one, other), _correlation(weak, one, other)]
        return np.array(result)

    def _residual(self, miss: Bools) -> Floats:
        """Misses less their mean among rows of similar mean quality ``[R]``."""
        end = np.quantile(self.location, np.linspace(0.0, 1.0, 11)[1:-1])
        group = np.searchsorted(end, self.location)
        mean = np.bincount(group, miss, 10) / np.maximum(
            np.bincount(group, minlength=10), 1
        )
        return np.asarray(miss - mean[group])


def _correlation(value: Floats, one: Ints, other: Ints) -> float:
    if len(one) < _FEW:
        return float("nan")
    first = value[one]
    second = value[other]
    mean = 0.5 * (first.mean() + second.mean())  # each pair counts in both orders
    first = first - mean
    second = second - mean
    square = first @ first + second @ second
    return float(2.0 * (first @ second) / square) if square > 0 else 0.0


def fit_ordered_levels(
    feature: Floats, level: Ints, levels: int, lapses: float
) -> tuple[Floats, Floats]:
    """Weights ``[n]`` of a mean over ``feature`` ``[R, n]``, and cuts ``[levels - 1]``, by maximum likelihood.

    ``level`` ``[R]`` 0, 1, ... is the number of cuts below a number with this mean and variance 1, whose lower tail has
    the exponential share ``lapses``; the first cut is 0.
    """
    share = np.cumsum(np.bincount(level, minlength=levels))[:-1] / len(level)
    start = ndtri(np.clip(share, 1e-3, 1 - 1e-3))
    gaps = np.log(np.maximum(np.diff(start), 1e-2))
    weight = np.zeros(feature.shape[1])
    weight[0] = -start[0]
    arguments = feature, level, lapses
    fitted = minimize(
        _level_loss,
        np.concatenate([weight, gaps]),
        arguments,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 1000},
    )
    weight, gaps = np.split(fitted.x, [feature.shape[1]])
    return weight, np.concatenate([[0.0], np.cumsum(np.exp(gaps) + _LEAST_STEP)])


def _level_loss(
    unknown: Floats, feature: Floats, level: Ints, lapses: float
) -> tuple[float, Floats]:
    """Mean negative log-likelihood and its gradient, over weights and logarithms of the gaps between cuts."""
    weight, gaps = np.split(unknown, [feature.shape[1]])
    cut = np.concatenate([[-1e3, 0.0], np.cumsum(np.exp(gaps) + _LEAST_STEP), [1e3]])
    mean = feature @ weight
    low = cut[level] - mean
    high = cut[level + 1] - mean
    # of the mirrored number, with the exponential tail above
    chance = np.maximum(skewed_cdf(-low, lapses) - skewed_cdf(-high, lapses), _TINY)
    at_low, at_high = (skewed_density(-x, lapses) / chance for x in (low, high))
    weight_slope = feature.T @ (at_high - at_low)
    cut_slope = np.bincount(level, at_low, len(cut)) - np.bincount(
        level + 1, at_high, len(cut)
    )
    gap_slope = np.cumsum(cut_slope[2:-1][::-1])[::-1] * np.exp(gaps)
    penalty = 0.5 * _RIDGE * float(weight[1:] @ weight[1:])
    weight_slope[1:] += _RIDGE * weight[1:]
    count = len(level)
    return (penalty - float(np.log(chance).sum())) / count, np.concatenate(
        [weight_slope, gap_slope]
    ) / count


def nearest_parameters(
    figures: Callable[[Floats], Floats], real: Floats, scale: Floats, start: Floats
) -> Floats:
    """Unknowns with ``figures`` nearest to the ``real`` ones that are known, in units of ``scale``."""
    finite = np.isfinite(real)

    def loss(unknown: Floats) -> Floats:
        difference = (np.nan_to_num(figures(unknown)) - real)[finite] / scale[finite]
        return np.concatenate([difference, _PRIOR * (unknown - start)])

    def slope(unknown: Floats) -> Floats:
        current = loss(unknown)
        return (
            np.stack(
                [loss(unknown + step) - current for step in _STEP * np.eye(len(start))],
                axis=-1,
            )
            / _STEP
        )

    return np.asarray(
        least_squares(
            loss,
            start,
            slope,
            (-_FARTHEST, _FARTHEST),
            "dogbox",
            max_nfev=_SEARCH_ROUNDS,
        ).x
    )


def from_log_odds(log_odds: float) -> float:
    """Share with these log-odds."""
    return float(1.0 / (1.0 + np.exp(-log_odds)))
