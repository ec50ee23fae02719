"""Errors of detected boxes: position, heading, size, height and velocity."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.special import chdtri, ndtr

from ..geometry import rotate, wrap_angle
from ..types import Bools, Floats
from .draws import Component, Draws, NoiseKind, at_period, keys_of, stationary
from .grid import Grid, Neighbours
from .profile import ClassNoise, PositionNoise

FARTHEST = 2.0  # m: a larger position error would turn it into another object's detection
ROBUST_T4 = 1.4826 * 0.7406970841  # robust standard deviation of Student's t with 4 degrees of freedom
_SMALLEST = 0.2, 0.3  # m and share of the true size: the larger one is the least estimated side
_LATENT = np.linspace(-5.0, 5.0, 1001)  # tails beyond are as heavy as at the ends


def position_errors(
    grid: Grid, distance: Floats, direction: Floats, quality: Floats, neighbours: Neighbours | None, draws: Draws
) -> Floats:
    """Position errors ``[R, 2]`` m of boxes at ``distance`` ``[R]`` m.

    ``direction`` ``[R]`` rad points from the sensor to them; ``quality`` ``[R]`` is the random part of their quality.
    """
    tails = _tail_factors(grid, draws)

    def error(axis: Callable[[ClassNoise], PositionNoise], kind: NoiseKind) -> Floats:
        latent = grid.latent(axis, neighbours, draws, kind)
        s0, s1, gain = grid.of_rows(lambda noise: (axis(noise).s0, axis(noise).s1, axis(noise).quality)).T
        scale = (s0 + s1 * distance / 10) * np.exp(-gain * quality)
        return np.asarray(np.clip(scale * tails * latent, -FARTHEST, FARTHEST))

    radial = error(lambda noise: noise.radial, NoiseKind.RADIAL)
    tangential = error(lambda noise: noise.tangential, NoiseKind.TANGENTIAL)
    return rotate(np.stack([radial, tangential], axis=-1), direction)


def _tail_factors(grid: Grid, draws: Draws) -> Floats:
    """Factors ``[R]`` that turn normal numbers into Student's t; they last as the radial error does."""
    bias, ar, phi, nu = grid.of_objects(lambda n: (n.radial.bias, n.radial.ar, n.radial.phi, n.nu)).T
    lasts = bias + ar > 0  # otherwise they are new in every frame
    latent = grid.lasting(bias / np.maximum(bias + ar, 1e-12), phi, draws, NoiseKind.TAIL)
    if not lasts.all():
        latent = np.where(lasts[grid.column], latent, draws.normal(NoiseKind.TAIL, Component.WHITE, grid.row_keys))
    factor = np.ones(len(latent))
    row_nu = nu[grid.column]
    for freedom in np.unique(nu):
        rows = row_nu == freedom
        factor[rows] = np.interp(latent[rows], _LATENT, _mixing_quantiles(float(freedom)))
    return factor


@lru_cache(maxsize=256)
def _mixing_quantiles(nu: float) -> Floats:
    """Square root of nu over a chi-squared number, at the ranks of `_LATENT` from above."""
    return np.asarray(np.sqrt(nu / chdtri(nu, ndtr(_LATENT))))


def estimated_boxes(true: Floats, offset: Floats, grid: Grid, draws: Draws) -> Floats:
    """Detected boxes ``[R, 7]`` of ``true`` boxes, with position errors ``offset`` ``[R, 2]`` m."""
    box = np.array(true, dtype=np.float64)
    box[:, :2] += offset
    mean, deviation = grid.of_rows(lambda noise: noise.z).T
    box[:, 2] += mean + deviation * draws.normal(NoiseKind.Z, Component.WHITE, grid.row_keys)
    scale = grid.of_rows(lambda noise: noise.heading.scale) / ROBUST_T4
    flipped = _flips(grid, draws)[grid.frame, grid.column]
    box[:, 3] = wrap_angle(box[:, 3] + (scale * _student_t4(grid, draws) + np.pi * flipped))
    box[:, 4:] = _estimated_sizes(box[:, 4:], grid, draws)
    return box


def measured_velocities(true: Floats, grid: Grid, direction: Floats, draws: Draws) -> Floats:
    """Measured velocities ``[R, 2]`` m/s; NaN where the class has none or the true one is unknown."""
    deviation = grid.of_rows(lambda noise: np.nan if noise.velocity is None else noise.velocity)
    if np.isnan(deviation).all():
        return np.full(true.shape, np.nan)
    error = draws.normal(NoiseKind.VELOCITY, Component.WHITE, keys_of(grid.row_keys[:, None], np.arange(2)))
    return np.asarray(true + rotate(deviation[:, None] * error, direction))


def _flips(grid: Grid, draws: Draws) -> Bools:
    """Mask of headings that are turned by pi ``[F, J]``: two-state Markov chains."""
    flip, flip_again = grid.of_objects(lambda noise: (noise.heading.flip, noise.heading.flip_again)).T
    after_no, after_yes = at_period(flip, flip_again, grid.steps)
    state = np.zeros((grid.frames, len(grid.ids)), dtype=bool)
    if not after_no.any():
        return state
    uniform = grid.on_grid(draws.uniform(NoiseKind.FLIP, Component.PUSH, grid.cell_keys), other=1.0)
    begins = np.arange(grid.frames)[:, None] == grid.span[0] % grid.frames
    first, previous = stationary(after_no, after_yes), state[0]
    for t in range(grid.frames):
        chance = np.where(begins[t], first, np.where(previous, after_yes, after_no))
        previous = state[t] = uniform[t] < chance
    return state


def _student_t4(grid: Grid, draws: Draws) -> Floats:
    """Student's t with 4 degrees of freedom ``[R]``: a normal number over the root of a chi-squared one."""
    first, second = (
        draws.uniform(NoiseKind.HEADING, component, grid.row_keys) for component in (Component.PUSH, Component.OTHER)
    )
    square = -0.5 * np.log(first * second)
    return np.asarray(draws.normal(NoiseKind.HEADING, Component.WHITE, grid.row_keys) / np.sqrt(square))


def _estimated_sizes(true: Floats, grid: Grid, draws: Draws) -> Floats:
    """Estimated length, width, height ``[R, 3]`` m."""
    bias = draws.normal(NoiseKind.SIZE, Component.BIAS, keys_of(grid.object_keys[:, None], np.arange(3)))
    white = draws.normal(NoiseKind.SIZE, Component.WHITE, keys_of(grid.row_keys[:, None], np.arange(3)))
    share = grid.of_rows(lambda noise: noise.size.white)[:, None]
    latent = np.sqrt(1 - share) * bias[grid.column] + np.sqrt(share) * white
    error = grid.of_rows(lambda noise: noise.size.mean) + grid.of_rows(lambda noise: noise.size.deviation) * latent
    least = np.minimum(true, np.maximum(_SMALLEST[0], _SMALLEST[1] * true))
    return np.asarray(np.maximum(true + error, least))
