"""The quality of every object in every frame, and what follows at once: its score, and whether it is reported."""

from __future__ import annotations

from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ...types import Bools, Floats, Ints
from ..sight import Sight, features
from .draws import Draws, Grid, Kind
from .neighbours import Neighbours
from .profile import RANKS
from .skewed import below, exceeded, raised


class Qualities(NamedTuple):
    """Of every row of the truth."""

    random: Floats  # [R] mean 0, variance 1, with memory: how much better than usual at this distance and occlusion
    score: Floats  # [R]
    present: Bools  # [R] there is a detection, at some score
    reported: Bools  # [R] its score reaches the operating point


def qualities(grid: Grid, sight: Sight, neighbours: Neighbours, draws: Draws) -> Qualities:
    """Qualities of all rows, covered by the sensor or not."""
    random = random_quality(grid, neighbours, draws)
    location = (location_features(features(sight)) * grid.of_rows(lambda noise: noise.quality.location)).sum(-1)
    score, present, floor = np.zeros(len(random)), np.zeros(len(random), dtype=bool), np.zeros(len(random))
    for noise, rows in grid.by_noise():
        law = noise.quality
        quality, floor[rows] = location[rows] + random[rows], law.floor
        score[rows], present[rows] = np.interp(quality, law.latent, law.score), quality >= law.latent[0]
    return Qualities(random, score, present, present & (score >= floor))


def random_quality(grid: Grid, neighbours: Neighbours, draws: Draws) -> Floats:
    """The random part of the quality ``[R]``: a normal number, less the exponential one of a lapse."""
    usual = grid.latent(lambda noise: noise.quality, neighbours, draws, Kind.QUALITY)
    lapses = attrgetter("bias", "phi", "shared", "share")
    bias, phi, shared, share = grid.of_objects(lambda n: lapses(n.quality.lapses)).T
    lapse = neighbours.shared(grid.lasting(bias, phi, draws, Kind.LAPSE), shared[grid.column])
    return -raised(-usual, lapse, share[grid.column])


def location_features(feature: Floats) -> Floats:
    """``[R, 7]`` 1, d, d^2, partly, largely, hidden, truncated, of `features` ``[R, 6]``."""
    return np.column_stack([feature[:, :2], feature[:, 1] ** 2, feature[:, 2:]])


def score_by_rank(rank: Floats, quantile: tuple[float, ...]) -> Floats:
    """Scores with ranks in 0..1, by the quantiles at `RANKS` of their law."""
    return np.asarray(np.interp(rank, RANKS, quantile))


def seen_rank(quality: Floats, tail: float, chance: float) -> tuple[Ints, Floats]:
    """Which numbers of `raised` are among the highest ``chance`` ``[S]``, and their ranks 0..1 among those ``[S]``."""
    seen = np.flatnonzero(quality >= exceeded(chance, tail))
    rank = (below(quality[seen], tail) - (1.0 - chance)) / chance
    return seen, np.clip(rank, 0.0, 1.0)
