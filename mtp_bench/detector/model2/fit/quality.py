"""The quality of true objects: its mean and the scores by likelihood, how it lasts and is shared by simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ....types import Bools, Floats, Ints
from ...fit.samples import ObjectSamples
from ..draws import Draws, Grid
from ..neighbours import Neighbours, neighbours_of
from ..profile import ClassNoise, Lapses, Quality
from ..quality import location_features, random_quality
from .latent import ordered_levels
from .search import nearest, odds

LENGTH = 20.0  # m: farther objects share nothing
_SHARES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995)  # of the scores, below the cuts
_BEST = 1.5  # the highest score belongs to a quality that much above the last cut
_LAPSES = (0.1, 0.3, 0.5, 0.7)  # shares of the variance, of which the best one is taken
_LAGS = (1, 3, 8)  # frames
_BANDS = ((0.0, 5.0), (5.0, 10.0))  # m between neighbours
_SECOND = 0.15  # share of the hits below a second floor at which misses are compared too
_FEW = 60  # pairs from which a figure is taken
_SEEDS = 8
_ROUNDS = 5
_START = np.array([1.0, 0.0, 1.0, -0.5, 0.5, 1.0, 0.0])
_SCALE = 0.03  # of all figures, which are correlations


def fit_quality(objects: ObjectSamples, floor: float) -> Quality:
    """The quality whose figures are nearest to the real ones, over shares of lapses."""
    scored = float(np.ptp(objects.score[objects.hit])) > 0
    best, least = None, np.inf
    for lapses in _LAPSES:
        law = _margins(objects, floor, lapses)
        stage = Stage.of(objects, law)
        real = stage.figures(objects.hit, objects.score)
        unknown = nearest(stage.made_of, real, np.full(len(real), _SCALE), _START, _ROUNDS)
        off = (stage.made_of(unknown) - real)[np.isfinite(real)] / _SCALE
        if float(off @ off) < least:
            best, least = _with(law, unknown), float(off @ off)
        if not scored and lapses == _LAPSES[1]:
            break
    assert best is not None
    return best


def _margins(objects: ObjectSamples, floor: float, lapses: float) -> Quality:
    """Location and scores: a miss is the lowest level. The memory is not fitted yet."""
    score = objects.score[objects.hit]
    cut = np.unique(np.append(np.quantile(score, _SHARES), floor))
    cut = cut[cut >= floor][: 1 if score.min() == score.max() else None]  # without scores: the floor alone
    level = np.zeros(len(objects.hit), dtype=np.int64)
    level[objects.hit] = np.maximum(np.searchsorted(cut, score, side="right"), 1)
    weight, latent = ordered_levels(location_features(objects.feature), level, len(cut) + 1, lapses)
    return Quality(
        bias=0.5,
        ar=0.3,
        phi=0.7,
        white=0.2,
        location=tuple(round(float(one), 4) for one in weight),
        lapses=Lapses(share=lapses, bias=0.5, phi=0.7, shared=0.5),
        latent=tuple(round(float(one), 4) for one in (*latent, latent[-1] + _BEST)),
        score=tuple(round(float(one), 4) for one in (*cut, float(score.max()))),
        floor=floor,
    )


def _with(law: Quality, unknown: Floats) -> Quality:
    """The law with the memory that unknowns stand for."""
    lasting, constant, phi, shared, of_bias, of_phi, of_shared = (odds(float(one)) for one in unknown)
    bias, ar = round(lasting * constant, 4), round(lasting * (1 - constant), 4)
    lapses = law.lapses.model_copy(
        update={"bias": round(of_bias, 4), "phi": round(of_phi, 4), "shared": round(of_shared, 4)}
    )
    white = round(1.0 - bias - ar, 4)
    update = {"bias": bias, "ar": ar, "phi": round(phi, 4), "white": white, "shared": round(shared, 4)}
    return law.model_copy(update={**update, "lapses": lapses})


def random_part(objects: ObjectSamples, law: Quality) -> Floats:
    """The random part of the quality ``[R]``, NaN where undetected."""
    location = location_features(objects.feature) @ np.array(law.location)
    value = np.full(len(location), np.nan)
    value[objects.hit] = np.interp(objects.score[objects.hit], law.score, law.latent)
    return np.asarray(value - location)


@dataclass(frozen=True, eq=False)
class Stage:
    """True objects of a class over scenes, as one long scene in which a quality can be drawn."""

    grid: Grid
    neighbours: Neighbours
    location: Floats  # [R]
    law: Quality  # with the margins
    second: float  # score
    pairs: tuple[tuple[Ints, Ints], ...]  # of an object, by `_LAGS`
    beside: tuple[tuple[Ints, Ints], ...]  # of neighbours, by `_BANDS`

    @classmethod
    def of(cls, objects: ObjectSamples, law: Quality) -> Stage:
        """The stage of samples."""
        width = int(objects.frame.max(initial=0)) + 1
        ids, column = np.unique(objects.object, return_inverse=True)
        none = np.zeros(len(ids), dtype=np.int64)
        grid = Grid(width, ids, objects.frame, column, (), none, 1.0)
        moment = objects.scene * width + objects.frame
        near = neighbours_of(objects.place, moment, objects.object, LENGTH)
        off = np.hypot(*(objects.place[near.row] - objects.place[near.other]).T)
        bands = [(off > low) & (off <= high) & (near.row < near.other) for low, high in _BANDS]
        second = float(np.quantile(objects.score[objects.hit], _SECOND))
        return cls(
            grid,
            near,
            location_features(objects.feature) @ np.array(law.location),
            law,
            second,
            tuple(objects.pairs(lag) for lag in _LAGS),
            tuple((near.row[band], near.other[band]) for band in bands),
        )

    def made_of(self, unknown: Floats) -> Floats:
        """Figures of a simulated quality with the memory that unknowns stand for, mean over seeds."""
        law = _with(self.law, unknown)
        grid = replace(self.grid, noise=(ClassNoise.model_construct(quality=law),))
        made = []
        for seed in range(_SEEDS):
            quality = self.location + random_quality(grid, self.neighbours, Draws(seed))
            hit = quality >= law.latent[0]
            made.append(self.figures(hit, np.interp(quality, law.latent, law.score)))
        return np.asarray(np.nan_to_num(made).mean(axis=0))

    def figures(self, hit: Bools, score: Floats) -> Floats:
        """Correlations over frames and between neighbours: of qualities that are seen, and of misses.

        ``hit`` [R] and ``score`` [R], NaN where undetected: what a detector shows of the objects.
        """
        value = np.interp(np.nan_to_num(score), self.law.score, self.law.latent) - self.location
        strong = hit & (np.nan_to_num(score, nan=-np.inf) >= self.second)  # reaches the second floor too
        found = []
        weak, missed = self._surprise(~strong), self._surprise(~hit)
        for one, other in (*self.pairs, *self.beside):
            both = hit[one] & hit[other]
            found.append(_correlation(value, one[both], other[both]))
            found += [_correlation(missed, one, other), _correlation(weak, one, other)]
        return np.array(found)

    def _surprise(self, miss: Bools) -> Floats:
        """Misses less their mean at like locations ``[R]``."""
        end = np.quantile(self.location, np.linspace(0.0, 1.0, 11)[1:-1])
        group = np.searchsorted(end, self.location)
        mean = np.bincount(group, miss, 10) / np.maximum(np.bincount(group, minlength=10), 1)
        return np.asarray(miss - mean[group])


def _correlation(value: Floats, one: Ints, other: Ints) -> float:
    if len(one) < _FEW:
        return float("nan")
    first, second = value[one], value[other]
    mean = 0.5 * (first.mean() + second.mean())  # each pair counts in both orders
    first, second = first - mean, second - mean
    square = first @ first + second @ second
    return float(2.0 * (first @ second) / square) if square > 0 else 0.0
