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
from .profile import DISTANCE_UNIT_M, SCORE_RANKS, ClassNoise
from .visibility import HIDDEN, LARGELY, PARTLY, Visibility


class Qualities(NamedTuple):
    """Qualities of the R rows of a truth.

    The random part has mean 0, variance 1 and a memory: it is the difference from the
    mean at this distance and occlusion.
    """

    random: Floats  # [R]
    score: Floats  # [R]
    detected: Bools  # [R] there is a detection, at any score
    reported: Bools  # [R] its score reaches the operating point


def draw_qualities(
    grid: Grid, visibility: Visibility, neighbours: Neighbours, draws: Draws
) -> Qualities:
    """Draw qualities of all rows, also of those outside the sensor's coverage."""
    random = random_quality(grid, neighbours, draws)
    mean_quality = (
        quality_features(visibility) * grid.of_rows("quality.location")
    ).sum(-1)
    quality = mean_quality + random
    row_scores = np.zeros(len(random))
    is_detected = np.zeros(len(random), dtype=bool)
    for noise, rows in grid.by_noise():
        curve = noise.quality
        row_scores[rows] = np.interp(quality[rows], curve.latent, curve.score)
        # the curve begins at the least quality of a detection
        is_detected[rows] = quality[rows] >= curve.latent[0]
    is_reported = is_detected & (row_scores >= grid.of_rows("quality.floor"))
    return Qualities(random, row_scores, is_detected, is_reported)


def random_quality(grid: Grid, neighbours: Neighbours, draws: Draws) -> Floats:
    """Return the random part of the quality [R].

    It is a normal number, less the exponential number of a lapse.
    """
    kinds = (NoiseKind.QUALITY, NoiseKind.LAPSE)
    lasting = grid.lasting(_memories, neighbours, draws, kinds)
    new = draws.normal(NoiseKind.QUALITY, Component.WHITE, grid.row_keys)
    normal, lapse = grid.with_new(lasting, new, _memories)
    return -skewed(-normal, exponential(lapse), grid.of_rows("quality.lapses.share"))


def _memories(noise: ClassNoise) -> tuple[Shares, Shares]:
    lapses = noise.quality.lapses  # no part of them is new in every frame
    return shares_of(noise.quality), (lapses.bias, lapses.phi, lapses.shared, 0.0)


def quality_features(visibility: Visibility) -> Floats:
    """Return features [R, 7] of the mean quality.

    They are 1, d, d^2, partly, largely occluded, hidden, truncated.
    """
    distance = visibility.distance / DISTANCE_UNIT_M
    levels = [visibility.occlusion == level for level in (PARTLY, LARGELY, HIDDEN)]
    powers = [np.ones(len(distance)), distance, distance**2]
    flags = np.array([*levels, visibility.truncated], dtype=float)
    return np.stack([*powers, *flags], axis=-1)


def score_by_rank(quality_rank: Floats, quantiles: tuple[float, ...]) -> Floats:
    """Return scores with ranks in 0..1, from their quantiles at `SCORE_RANKS`."""
    return np.interp(quality_rank, SCORE_RANKS, quantiles)


def best_ranks(quality: Floats, tail: float, chance: float) -> tuple[Ints, Floats]:
    """Return the indices of the highest ``chance`` of `skewed` numbers [S].

    Beside them their ranks 0..1 among those. ``tail``: their exponential share.
    """
    best_rows = np.flatnonzero(quality >= skewed_quantile(chance, tail))
    quality_rank = (skewed_cdf(quality[best_rows], tail) - (1.0 - chance)) / chance
    return best_rows, np.clip(quality_rank, 0.0, 1.0)
