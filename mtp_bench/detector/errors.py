"""Errors of detected boxes: position, heading, size, height and velocity."""

from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter

import numpy as np
from scipy.special import chdtri, ndtr

from ..geometry import rotate, wrap_angle
from ..types import Bools, Floats, Ints
from .draws import Component, Draws, NoiseKind, at_period, keys_of, stationary
from .grid import Grid, Neighbours

FARTHEST = 2.0  # m: a larger position error would turn it into another object's detection
ROBUST_T4 = 1.4826 * 0.7406970841  # robust standard deviation of Student's t with 4 degrees of freedom
_SMALLEST = 0.2, 0.3  # m and share of the true size: the larger one is the least estimated side
_LATENT = np.linspace(-5.0, 5.0, 1001)  # tails beyond are as heavy as at the ends


@dataclass(frozen=True, eq=False)
class BoxErrors:
    """Random part of the errors of R detected boxes."""

    latent: Floats  # [R, 2] along and across the line of sight
    tail: Floats  # [R] factors that turn normal numbers into Student's t
    scale: Floats  # [R, 2, 3] s0, s1, quality of both position errors
    z: Floats  # [R] m
    turn: Floats  # [R] rad, of the heading
    size: Floats  # [R, 3] m
    velocity: Floats  # [R, 2] m/s, along and across the line of sight; NaN where not measured


def draw_errors(grid: Grid, neighbours: Neighbours | None, draws: Draws, rows: Ints | None = None) -> BoxErrors:
    """Draw the errors of all rows of a grid, or of some ``rows``; ``neighbours``, if any, share the lasting ones."""
    if rows is not None and grid.memory is None and neighbours is None:
        grid, rows = grid.select(rows), None
    axes = (("radial", NoiseKind.RADIAL), ("tangential", NoiseKind.TANGENTIAL))
    latent = np.stack([grid.latent(attrgetter(axis), neighbours, draws, kind) for axis, kind in axes], axis=-1)
    tail, flipped = _tail_factors(grid, draws), _flips(grid, draws)
    if rows is not None:
        grid, latent, tail, flipped = grid.select(rows), latent[rows], tail[rows], flipped[rows]
    scales = [grid.of_rows(attrgetter(f"{axis}.s0", f"{axis}.s1", f"{axis}.quality")) for axis, _ in axes]
    mean, deviation, heading = grid.of_rows(lambda n: (*n.z, n.heading.scale)).T
    z = mean + deviation * draws.normal(NoiseKind.Z, Component.WHITE, grid.row_keys)
    turn = heading / ROBUST_T4 * _student_t4(grid, draws) + np.pi * flipped
    sizes, velocity = _size_errors(grid, draws), _velocity_errors(grid, draws)
    return BoxErrors(latent, tail, np.stack(scales, axis=1), z, turn, sizes, velocity)


def detected_boxes(
    box: Floats, velocity: Floats, errors: BoxErrors, distance: Floats, direction: Floats, quality: Floats
) -> tuple[Floats, Floats]:
    """Detected boxes ``[R, 7]`` and velocities ``[R, 2]`` of true ones at ``distance`` ``[R]`` m.

    ``direction`` ``[R]`` rad points from the sensor to them; ``quality`` ``[R]`` is the random part of their quality.
    Velocities are NaN where the class has none or the true one is unknown.
    """
    s0, s1, gain = np.moveaxis(errors.scale, -1, 0)
    scale = (s0 + s1 * distance[:, None] / 10) * np.exp(-gain * quality[:, None])
    offset = np.clip(scale * errors.tail[:, None] * errors.latent, -FARTHEST, FARTHEST)
    found, size = np.array(box, dtype=np.float64), box[:, 4:]
    found[:, :2] += rotate(offset, direction)
    found[:, 2] += errors.z
    found[:, 3] = wrap_angle(found[:, 3] + errors.turn)
    least = np.minimum(size, np.maximum(_SMALLEST[0], _SMALLEST[1] * size))
    found[:, 4:] = np.maximum(size + errors.size, least)
    if np.isnan(errors.velocity).all():
        return found, np.full(velocity.shape, np.nan)
    return found, velocity + rotate(errors.velocity, direction)


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


def _velocity_errors(grid: Grid, draws: Draws) -> Floats:
    """Errors of velocities ``[R, 2]`` m/s; NaN where the class has none."""
    deviation = grid.of_rows(lambda noise: np.nan if noise.velocity is None else noise.velocity)
    if np.isnan(deviation).all():
        return np.full((len(deviation), 2), np.nan)
    error = draws.normal(NoiseKind.VELOCITY, Component.WHITE, keys_of(grid.row_keys[:, None], np.arange(2)))
    return np.asarray(deviation[:, None] * error)


def _flips(grid: Grid, draws: Draws) -> Bools:
    """Mask of headings that are turned by pi ``[R]``: two-state Markov chains."""
    flip, flip_again = grid.of_objects(lambda noise: (noise.heading.flip, noise.heading.flip_again)).T
    after_no, after_yes = at_period(flip, flip_again, grid.steps)
    if not after_no.any():
        return np.zeros(len(grid.column), dtype=bool)
    first, uniform = stationary(after_no, after_yes), draws.uniform(NoiseKind.FLIP, Component.PUSH, grid.cell_keys)
    if grid.memory is not None:
        before = grid.memory.before(draws.subject, NoiseKind.FLIP, len(grid.ids)) > 0
        state = uniform < np.where(grid.span[0] == grid.memory.frame, first, np.where(before, after_yes, after_no))
        grid.memory.series[draws.subject, NoiseKind.FLIP] = state.astype(np.float64)
        return state[grid.column]
    uniform, begins = grid.on_grid(uniform, other=1.0), np.arange(grid.frames)[:, None] == grid.span[0] % grid.frames
    states = np.zeros((grid.frames, len(grid.ids)), dtype=bool)
    previous = states[0]
    for t in range(grid.frames):
        chance = np.where(begins[t], first, np.where(previous, after_yes, after_no))
        previous = states[t] = uniform[t] < chance
    return states[grid.frame, grid.column]


def _student_t4(grid: Grid, draws: Draws) -> Floats:
    """Student's t with 4 degrees of freedom ``[R]``: a normal number over the root of a chi-squared one."""
    first, second = (
        draws.uniform(NoiseKind.HEADING, component, grid.row_keys) for component in (Component.PUSH, Component.OTHER)
    )
    square = -0.5 * np.log(first * second)
    return np.asarray(draws.normal(NoiseKind.HEADING, Component.WHITE, grid.row_keys) / np.sqrt(square))


def _size_errors(grid: Grid, draws: Draws) -> Floats:
    """Errors of length, width, height ``[R, 3]`` m."""
    bias = draws.normal(NoiseKind.SIZE, Component.BIAS, keys_of(grid.object_keys[:, None], np.arange(3)))
    white = draws.normal(NoiseKind.SIZE, Component.WHITE, keys_of(grid.row_keys[:, None], np.arange(3)))
    share = grid.of_rows(lambda noise: noise.size.white)[:, None]
    latent = np.sqrt(1 - share) * bias[grid.column] + np.sqrt(share) * white
    return grid.of_rows(lambda noise: noise.size.mean) + grid.of_rows(lambda noise: noise.size.deviation) * latent
