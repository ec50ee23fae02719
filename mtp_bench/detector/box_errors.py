"""Errors of detected boxes: position, heading, size, height, score, velocity and duplicates."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ..geometry import wrap_angle
from ..types import Bools, Floats
from .chains import at_period, stationary, two_state
from .grid import Grid
from .profile import ClassNoise, PositionNoise
from .sight import Sight
from .streams import Kind, stream

FARTHEST = 2.0  # m: a position error beyond would be another object's detection
SMALLEST = 0.2, 0.3  # m and share of the true size: no side of a box is estimated below the larger of both
_ROBUST_T4 = 1.4826 * 0.7406970841  # robust standard deviation of Student's t with 4 degrees of freedom
_BESIDE = 0.2  # m, deviation per axis of a duplicate from its original
_WEAKER = 0.5  # a duplicate scores less by this share of the score's deviation times a half-normal number
_LATENT = np.linspace(0.0, 8.0, 801)  # a standard normal number beyond happens once in 10^15


def box_errors(truth_box: Floats, grid: Grid, sight: Sight, toward: Floats, seed: int) -> Floats:
    """Boxes ``[R, 7]`` as the detector would estimate them; ``toward`` ``[R]`` rad points from the sensor."""
    box = np.array(truth_box, dtype=np.float64)
    radial = _position_error(grid, sight, lambda noise: noise.radial, stream(seed, Kind.RADIAL))
    tangential = _position_error(grid, sight, lambda noise: noise.tangential, stream(seed, Kind.TANGENTIAL))
    box[:, :2] += turned(np.stack([radial, tangential], axis=-1), toward)
    mean, deviation = grid.of_rows(lambda noise: noise.z).T
    box[:, 2] += mean + deviation * grid.rows_of(stream(seed, Kind.Z).standard_normal(grid.shape))
    box[:, 3] = wrap_angle(box[:, 3] + _heading_error(grid, seed))
    box[:, 4:] = _sizes(box[:, 4:], grid, seed)
    return box


def scores(grid: Grid, sight: Sight, seed: int) -> Floats:
    """Score of every row ``[R]`` between the detector's floor and ceiling."""
    latent = grid.latent(lambda noise: noise.score, stream(seed, Kind.SCORE))
    distance = sight.distance / 10
    constant, slope, curve = grid.of_rows(lambda noise: noise.score.quadratic).T
    mean = constant + slope * distance + curve * distance**2
    return within_score_limits(mean + grid.of_rows(lambda noise: noise.score.deviation) * latent, grid)


def within_score_limits(score: Floats, grid: Grid) -> Floats:
    """Scores ``[R]`` brought between floor and ceiling."""
    ceiling = grid.of_rows(lambda noise: np.inf if noise.score.ceiling is None else noise.score.ceiling)
    return np.clip(score, grid.of_rows(lambda noise: noise.score.floor), ceiling)


def velocities(truth_velocity: Floats, grid: Grid, toward: Floats, seed: int) -> Floats:
    """Measured velocities ``[R, 2]`` m/s; NaN where the class has none or the truth is unknown."""
    deviation = grid.of_rows(lambda noise: np.nan if noise.velocity is None else noise.velocity)
    error = grid.rows_of(stream(seed, Kind.VELOCITY).standard_normal((*grid.shape, 2)))
    return truth_velocity + turned(deviation[:, None] * error, toward)


def duplicates(box: Floats, score: Floats, grid: Grid, toward: Floats, seed: int) -> tuple[Bools, Floats, Floats]:
    """Which detections come twice ``[R]``; box ``[R, 7]`` and score ``[R]`` that the second of each would have."""
    rng = stream(seed, Kind.DUPLICATE)
    uniform, normal = rng.random(grid.shape), rng.standard_normal((*grid.shape, 3))
    twice = grid.rows_of(uniform) < grid.of_rows(lambda noise: noise.duplicates)
    offset = grid.rows_of(normal)
    second = box.copy()
    second[:, :2] += turned(_BESIDE * offset[:, :2], toward)
    weaker = score - _WEAKER * grid.of_rows(lambda noise: noise.score.deviation) * np.abs(offset[:, 2])
    return twice, second, within_score_limits(weaker, grid)


def turned(vector: Floats, angle: Floats) -> Floats:
    """Vectors ``[R, 2]`` turned counter-clockwise by angles ``[R]``: errors are drawn along and across a direction."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vector[:, 0], vector[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _position_error(
    grid: Grid, sight: Sight, axis: Callable[[ClassNoise], PositionNoise], rng: np.random.Generator
) -> Floats:
    """Error along one axis ``[R]``, metres."""
    latent = grid.latent(axis, rng)
    near, per_ten, nu = grid.of_rows(lambda noise: (axis(noise).s0, axis(noise).s1, axis(noise).nu)).T
    error = np.zeros(len(latent))
    for freedom in np.unique(nu):
        rows = nu == freedom
        error[rows] = np.sign(latent[rows]) * np.interp(np.abs(latent[rows]), _LATENT, _student(float(freedom)))
    return np.asarray(np.clip((near + per_ten * sight.distance / 10) * error, -FARTHEST, FARTHEST))


@lru_cache(maxsize=256)
def _student(nu: float) -> Floats:
    """Quantiles of Student's t where the normal distribution has `_LATENT`."""
    from scipy.special import ndtr, stdtrit

    return np.asarray(-stdtrit(nu, ndtr(-_LATENT)))


def _heading_error(grid: Grid, seed: int) -> Floats:
    """Error of the heading ``[R]``, radians, turns by pi included."""
    wobble = stream(seed, Kind.HEADING).standard_t(4, grid.shape)
    after_no = grid.of_objects(lambda noise: noise.heading.flip)
    after_yes = grid.of_objects(lambda noise: noise.heading.flip_again)
    after_no, after_yes = at_period(after_no, after_yes, grid.steps)
    begins = np.zeros(grid.shape, dtype=bool)
    begins[:1] = True
    chance = tuple(np.broadcast_to(p, grid.shape) for p in (stationary(after_no, after_yes), after_no, after_yes))
    flipped = two_state((chance[0], chance[1], chance[2]), begins, stream(seed, Kind.FLIP).random(grid.shape))
    scale = grid.of_rows(lambda noise: noise.heading.scale) / _ROBUST_T4
    return scale * grid.rows_of(wobble) + np.pi * grid.rows_of(flipped)


def _sizes(true: Floats, grid: Grid, seed: int) -> Floats:
    """Estimated length, width, height ``[R, 3]``."""
    rng = stream(seed, Kind.SIZE)
    bias, white = rng.standard_normal((grid.objects, 3)), rng.standard_normal((*grid.shape, 3))
    share = grid.of_rows(lambda noise: noise.size.white)[:, None]
    latent = np.sqrt(1 - share) * bias[grid.column] + np.sqrt(share) * grid.rows_of(white)
    error = grid.of_rows(lambda noise: noise.size.mean) + grid.of_rows(lambda noise: noise.size.deviation) * latent
    smallest = np.minimum(true, np.maximum(SMALLEST[0], SMALLEST[1] * true))
    return np.asarray(np.maximum(true + error, smallest))
