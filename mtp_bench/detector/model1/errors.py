"""Errors of detected boxes: position, heading, size, height, score, velocity and duplicates."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...geometry import rotate, wrap_angle
from ...types import Bools, Floats
from ..chains import at_period, stationary, two_state
from ..estimates import FARTHEST, ROBUST_T4, sized
from .draws import Grid, Kind, Streams
from .profile import ClassNoise, PositionNoise
from .truncated import within_limits

_BESIDE = 0.2  # m, deviation per axis of a duplicate from its original
_WEAKER = 0.5  # the latent number of a duplicate's score is lower by this times a half-normal number
_LATENT = np.linspace(0.0, 8.0, 801)  # a standard normal number beyond happens once in 10^15


def box_errors(true: Floats, grid: Grid, distance: Floats, toward: Floats, streams: Streams) -> Floats:
    """Boxes ``[R, 7]`` as the detector would estimate ``true`` ones at ``distance`` ``[R]`` m.

    ``true`` ``[R, 7]`` boxes; ``grid``: which frame and object each row is, and the noise of its class; ``toward``
    ``[R]`` rad points from the sensor to them; ``streams``: random numbers, one stream per kind of error.
    """
    box = reshaped(true, grid, streams)
    radial = _position_error(grid, distance, lambda noise: noise.radial, streams.of(Kind.RADIAL))
    tangential = _position_error(grid, distance, lambda noise: noise.tangential, streams.of(Kind.TANGENTIAL))
    box[:, :2] += rotate(np.stack([radial, tangential], axis=-1), toward)
    return box


def reshaped(true: Floats, grid: Grid, streams: Streams) -> Floats:
    """Boxes ``[R, 7]`` at their true places, with the errors of height, heading and size."""
    box = np.array(true, dtype=np.float64)
    mean, deviation = grid.of_rows(lambda noise: noise.z).T
    box[:, 2] += mean + deviation * grid.rows_of(streams.of(Kind.Z).standard_normal(grid.shape))
    box[:, 3] = wrap_angle(box[:, 3] + _heading_error(grid, streams))
    box[:, 4:] = _sizes(box[:, 4:], grid, streams)
    return box


def latent_scores(grid: Grid, streams: Streams) -> Floats:
    """The standard normal numbers behind the scores ``[R]``, with the memory of scores."""
    return grid.latent(lambda noise: noise.score, streams.of(Kind.SCORE))


def scores(latent: Floats, grid: Grid, distance: Floats) -> Floats:
    """Scores of true objects ``[R]`` at ``distance`` ``[R]`` m, between the detector's floor and ceiling."""
    ten = distance / 10
    constant, slope, curve = grid.of_rows(lambda noise: noise.score.quadratic).T
    deviation = grid.of_rows(lambda noise: noise.score.deviation)
    return scores_within(latent, constant + slope * ten + curve * ten**2, deviation, grid)


def scores_within(latent: Floats, location: Floats, deviation: Floats, grid: Grid) -> Floats:
    """Scores ``[R]`` between floor and ceiling, by rank of the latent numbers."""
    ceiling = grid.of_rows(lambda noise: np.inf if noise.score.ceiling is None else noise.score.ceiling)
    floor = grid.of_rows(lambda noise: noise.score.floor)
    return within_limits(latent, location, deviation, floor, ceiling)


def velocities(truth_velocity: Floats, grid: Grid, toward: Floats, streams: Streams) -> Floats:
    """Measured velocities ``[R, 2]`` m/s; NaN where the class has none or the truth is unknown."""
    deviation = grid.of_rows(lambda noise: np.nan if noise.velocity is None else noise.velocity)
    error = grid.rows_of(streams.of(Kind.VELOCITY).standard_normal((*grid.shape, 2)))
    return truth_velocity + rotate(deviation[:, None] * error, toward)


def duplicates(grid: Grid, toward: Floats, seed: int) -> tuple[Bools, Floats, Floats]:
    """Which detections come twice ``[R]``; how far beside ``[R, 2]`` m the second is, and how much weaker ``[R]``.

    The last one is in latent numbers.
    """
    rng = Streams(seed).of(Kind.DUPLICATE)
    uniform, normal = rng.random(grid.shape), rng.standard_normal((*grid.shape, 3))
    twice = grid.rows_of(uniform) < grid.of_rows(lambda noise: noise.duplicates)
    offset = grid.rows_of(normal)
    return twice, rotate(_BESIDE * offset[:, :2], toward), _WEAKER * np.abs(offset[:, 2])


def _position_error(
    grid: Grid, distance: Floats, axis: Callable[[ClassNoise], PositionNoise], rng: np.random.Generator
) -> Floats:
    """Error along one axis ``[R]``, metres."""
    latent = grid.latent(axis, rng)
    near, per_ten, nu = grid.of_rows(lambda noise: (axis(noise).s0, axis(noise).s1, axis(noise).nu)).T
    error = np.zeros(len(latent))
    for freedom in np.unique(nu):
        rows = nu == freedom
        error[rows] = np.sign(latent[rows]) * np.interp(np.abs(latent[rows]), _LATENT, _student(float(freedom)))
    return np.asarray(np.clip((near + per_ten * distance / 10) * error, -FARTHEST, FARTHEST))


@lru_cache(maxsize=256)
def _student(nu: float) -> Floats:
    """Quantiles of Student's t where the normal distribution has `_LATENT`."""
    from scipy.special import ndtr, stdtrit

    return np.asarray(-stdtrit(nu, ndtr(-_LATENT)))


def _heading_error(grid: Grid, streams: Streams) -> Floats:
    """Error of the heading ``[R]``, radians, turns by pi included."""
    wobble = streams.of(Kind.HEADING).standard_t(4, grid.shape)
    after_no = grid.of_objects(lambda noise: noise.heading.flip)
    after_yes = grid.of_objects(lambda noise: noise.heading.flip_again)
    after_no, after_yes = at_period(after_no, after_yes, grid.steps)
    begins = np.zeros(grid.shape, dtype=bool)
    begins[:1] = True
    chance = stationary(after_no, after_yes), after_no, after_yes
    flipped = two_state(chance, begins, streams.of(Kind.FLIP).random(grid.shape))
    scale = grid.of_rows(lambda noise: noise.heading.scale) / ROBUST_T4
    return scale * grid.rows_of(wobble) + np.pi * grid.rows_of(flipped)


def _sizes(true: Floats, grid: Grid, streams: Streams) -> Floats:
    """Estimated length, width, height ``[R, 3]``."""
    rng = streams.of(Kind.SIZE)
    bias, white = rng.standard_normal((grid.objects, 3)), rng.standard_normal((*grid.shape, 3))
    share = grid.of_rows(lambda noise: noise.size.white)[:, None]
    latent = np.sqrt(1 - share) * bias[grid.column] + np.sqrt(share) * grid.rows_of(white)
    error = grid.of_rows(lambda noise: noise.size.mean) + grid.of_rows(lambda noise: noise.size.deviation) * latent
    return sized(true, error)
