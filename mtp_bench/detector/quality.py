"""Quality of every object in every frame, and the score that follows from it."""

from typing import NamedTuple

import numpy as np

from ..core import Bools, Floats, Ints
from .draws import (
    Component,
    Draws,
    NoiseKind,
    exponential,
    skewed,
    skewed_cdf,
    skewed_quantile,
)
from .grid import Grid, Neighbours, Shares, shares_of
from .profile import RANKS, ClassNoise
from .visibility import HIDDEN, LARGELY, PARTLY, Visibility


class Qualities(NamedTuple):
    """Qualities of the R rows of a truth."""

    random: Floats  # [R] mean 0, variance 1, with memory: difference from the mean at this distance and occlusion
    score: Floats  # [R]
    detected: Bools  # [R] there is a detection, at any score
    reported: Bools  # [R] its score reaches the operating point


def draw_qualities(
    grid: Grid, visibility: Visibility, neighbours: Neighbours, draws: Draws
) -> Qualities:
    """Draw qualities of all rows, also of those outside the sensor's coverage."""
    random = random_quality(grid, neighbours, draws)
    location = (quality_features(visibility) * grid.of_rows("quality.location")).sum(-1)
    score, detected, floor = (
        np.zeros(len(random)),
        np.zeros(len(random), dtype=bool),
        np.zeros(len(random)),
    )
    for noise, rows in grid.by_noise():
        parameters = noise.quality
        quality, floor[rows] = location[rows] + random[rows], parameters.floor
        score[rows] = np.interp(quality, parameters.latent, parameters.score)
        detected[rows] = quality >= parameters.latent[0]
    return Qualities(random, score, detected, detected & (score >= floor))


def random_quality(grid: Grid, neighbours: Neighbours, draws: Draws) -> Floats:
    """Random part of the quality ``[R]``: a normal number, less the exponential number of a lapse."""
    lasting = grid.lasting(
        _memories, neighbours, draws, (NoiseKind.QUALITY, NoiseKind.LAPSE)
    )
    new = draws.normal(NoiseKind.QUALITY, Component.WHITE, grid.row_keys)
    normal, lapse = grid.with_new(lasting, new, _memories)
    return -skewed(-normal, exponential(lapse), grid.of_rows("quality.lapses.share"))


def _memories(noise: ClassNoise) -> tuple[Shares, Shares]:
    lapses = noise.quality.lapses
    return shares_of(noise.quality), (lapses.bias, lapses.phi, lapses.shared, 0.0)


def quality_features(visibility: Visibility) -> Floats:
    """Features of the mean quality ``[R, 7]``: 1, d, d^2, partly, largely occluded, hidden, truncated."""
    distance = visibility.distance / 10
    levels = [visibility.occlusion == level for level in (PARTLY, LARGELY, HIDDEN)]
    columns = [
        np.ones(len(distance)),
        distance,
        distance**2,
        *levels,
        visibility.truncated,
    ]
    return np.stack(columns, axis=-1)


def score_by_rank(rank: Floats, quantiles: tuple[float, ...]) -> Floats:
    """Scores with ranks in 0..1, from their quantiles at `RANKS`."""
    return np.interp(rank, RANKS, quantiles)


def best_ranks(quality: Floats, tail: float, chance: float) -> tuple[Ints, Floats]:
    """Indices of the highest ``chance`` of `skewed` numbers ``[S]``, and their ranks 0..1 among those ``[S]``.

    ``tail``: their exponential share.
    """
    index = np.flatnonzero(quality >= skewed_quantile(chance, tail))
    rank = (skewed_cdf(quality[index], tail) - (1.0 - chance)) / chance
    return index, np.clip(rank, 0.0, 1.0)
