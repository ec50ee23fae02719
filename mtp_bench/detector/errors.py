"""Errors of detected boxes: position, heading, size, height and velocity."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chdtri, ndtr, ndtri

from ..core import Bools, Floats, Ints, rotate, wrap_angle
from .draws import (
    Component,
    Draws,
    Keys,
    NoiseKind,
    at_period,
    keys_of,
    parts,
    stationary,
)
from .grid import Grid, Neighbours, Shares, shares_of
from .profile import DISTANCE_UNIT_M, ClassNoise

# a larger position error would turn it into another object's detection
_MAX_OFFSET_M = 2.0
# robust standard deviation of Student's t with 4 degrees of freedom: 1.4826 times its
# upper quartile
_ROBUST_T4 = 1.4826 * 0.7406970841
# the larger one is the least estimated side; the share is that of the true size
_MIN_SIZE_M = 0.2
_MIN_SIZE_SHARE = 0.3
_POSITION_KINDS = (NoiseKind.RADIAL, NoiseKind.TANGENTIAL, NoiseKind.TAIL)
_NEW_KINDS = (*_POSITION_KINDS, NoiseKind.Z, NoiseKind.HEADING)
# numbers of a row
_OF_ROWS = (
    *parts(Component.WHITE, *_NEW_KINDS),
    *parts(Component.PUSH, NoiseKind.HEADING),
    *parts(Component.SECOND, NoiseKind.HEADING),
)
# numbers of a row and axis
_OF_AXES = parts(Component.WHITE, NoiseKind.SIZE, NoiseKind.VELOCITY)
_SCALES = (
    "radial.s0 radial.s1 radial.quality tangential.s0 tangential.s1 tangential.quality"
)
_AXES = np.arange(3)
_LATENT = np.linspace(-5.0, 5.0, 1001)  # tails beyond are as heavy as at the ends


@dataclass(frozen=True, eq=False)
class BoxErrors:
    """Random part of the errors of R detected boxes."""

    # [R, 2] standard normal position errors, along and across the line of sight
    normal_offset: Floats
    tail: Floats  # [R] factors that turn normal numbers into Student's t
    scale: Floats  # [R, 2, 3] s0, s1, quality of both position errors
    z: Floats  # [R] m
    turn: Floats  # [R] rad, of the heading
    size: Floats  # [R, 3] m
    # [R, 2] m/s, along and across the line of sight; NaN where not measured
    velocity: Floats


def draw_errors(
    grid: Grid, neighbours: Neighbours | None, draws: Draws, row_index: Ints | None
) -> BoxErrors:
    """Draw the errors of rows of a grid.

    ``row_index``: some rows; None: all. ``neighbours``, if any, share the lasting part
    of the position errors.
    """
    # without memory and neighbours the numbers of a row do not need other rows
    if row_index is not None and grid.memory is None and neighbours is None:
        grid = grid.select(row_index)
        row_index = None
    lasting = grid.lasting(_memories, neighbours, draws, _POSITION_KINDS)
    flipped = _flips(grid, draws)
    if row_index is not None:
        grid = grid.select(row_index)
        lasting = lasting[:, row_index]
        flipped = flipped[row_index]
    uniform_numbers = draws.uniforms(_OF_ROWS, grid.row_keys)
    new_numbers = ndtri(uniform_numbers[: len(_NEW_KINDS)])
    first_uniform, second_uniform = uniform_numbers[len(_NEW_KINDS) :]
    new_position = new_numbers[: len(_POSITION_KINDS)]
    new_z, new_heading = new_numbers[len(_POSITION_KINDS) :]
    radial, tangential, tail = grid.with_new(lasting, new_position, _memories)
    mean_z, deviation_z = grid.of_rows("z").T
    # a normal number over the root of chi-squared / 4, which is -2 log(u v) / 4
    student_t4 = new_heading / np.sqrt(-0.5 * np.log(first_uniform * second_uniform))
    heading_error = grid.of_rows("heading.scale") / _ROBUST_T4 * student_t4
    normal_size, normal_velocity = ndtri(
        draws.uniforms(_OF_AXES, of_axes(grid.row_keys))
    )
    return BoxErrors(
        normal_offset=np.stack([radial, tangential], axis=-1),
        tail=_tail_factors(grid, tail),
        scale=grid.of_rows(_SCALES).reshape(-1, 2, 3),
        z=mean_z + deviation_z * new_z,
        turn=heading_error + np.pi * flipped,
        size=_size_errors(grid, draws, normal_size),
        velocity=grid.of_rows("velocity")[:, None] * normal_velocity[:, :2],
    )


def _memories(noise: ClassNoise) -> tuple[Shares, ...]:
    """Return memories of the position errors, and of their tails.

    Tails are as the radial error or new in every frame.
    """
    radial = shares_of(noise.radial)
    always_new = float(noise.radial.bias + noise.radial.ar <= 0)
    constant_share, phi, _, _ = radial
    tail = (constant_share, phi, 0.0, always_new)  # 0: neighbours share no tails
    return radial, shares_of(noise.tangential), tail


def detected_boxes(
    box: Floats,
    velocity: Floats,
    errors: BoxErrors,
    distance: Floats,
    direction: Floats,
    quality: Floats,
) -> tuple[Floats, Floats]:
    """Return detected boxes [R, 7] and velocities [R, 2] of true ones.

    ``distance`` [R] m: distance of the true boxes from the sensor; ``direction`` [R]
    rad points from the sensor to them; ``quality`` [R] is the random part of their
    quality. Velocities are NaN where the class has none or the true one is unknown.
    """
    s0, s1, quality_gain = np.moveaxis(errors.scale, -1, 0)
    scale_m = (s0 + s1 * distance[:, None] / DISTANCE_UNIT_M) * np.exp(
        -quality_gain * quality[:, None]
    )
    offset_m = scale_m * errors.tail[:, None] * errors.normal_offset
    offset_m = np.clip(offset_m, -_MAX_OFFSET_M, _MAX_OFFSET_M)
    offset_m, velocity_error = rotate(np.array([offset_m, errors.velocity]), direction)
    size = box[:, 4:]
    min_size = np.maximum(_MIN_SIZE_M, _MIN_SIZE_SHARE * size)
    detected = box.copy()
    detected[:, :2] += offset_m
    detected[:, 2] += errors.z
    detected[:, 3] = wrap_angle(detected[:, 3] + errors.turn)
    # no smaller than the least size, or than a true side below that
    detected[:, 4:] = np.maximum(size + errors.size, np.minimum(size, min_size))
    return detected, velocity + velocity_error


def _tail_factors(grid: Grid, latent_numbers: Floats) -> Floats:
    """Return factors [R] that turn normal numbers into Student's t.

    ``latent_numbers`` [R]: normal numbers.
    """
    tail_factors = np.ones(len(latent_numbers))
    row_nu = grid.of_rows("nu")
    for nu in {noise.nu for noise in grid.noise}:
        row_index = np.flatnonzero(row_nu == nu)
        tail_factors[row_index] = np.interp(
            latent_numbers[row_index], _LATENT, _mixing_quantiles(float(nu))
        )
    return tail_factors


@lru_cache(maxsize=256)
def _mixing_quantiles(nu: float) -> Floats:
    """Return the square root of nu over a chi-squared number.

    It is tabulated at the normal scores `_LATENT` and rises with them.
    """
    return np.asarray(np.sqrt(nu / chdtri(nu, ndtr(_LATENT))))


def _flips(grid: Grid, draws: Draws) -> Bools:
    """Return the mask [R] of headings that are turned by pi.

    The headings of an object follow a two-state Markov chain.
    """
    # chances of a flip after a frame without one, and after a flip
    flip, flip_again = grid.of_noise("heading.flip heading.flip_again").T
    after_no, after_yes = at_period(flip, flip_again, grid.steps)
    if not (len(grid.ids) and after_no.any()):
        return np.zeros(len(grid.column), dtype=bool)
    first_chance = stationary(after_no, after_yes)[grid.noise_number]
    after_no = after_no[grid.noise_number]
    after_yes = after_yes[grid.noise_number]
    uniform = draws.uniform(NoiseKind.FLIP, Component.PUSH, grid.cell_keys)
    if grid.memory is not None:
        name = (draws.subject, NoiseKind.FLIP)
        was_flipped = grid.memory.previous(name, uniform.shape) > 0
        flip_chance = np.where(was_flipped, after_yes, after_no)
        is_new = grid.span[0] == grid.memory.frame
        flip_chance = np.where(is_new, first_chance, flip_chance)
        is_flipped = uniform < flip_chance
        grid.memory.series[name] = is_flipped.astype(np.float64)
        return np.asarray(is_flipped[grid.column])
    uniform = grid.on_grid(uniform, elsewhere=1.0)
    begins = np.arange(grid.frames)[:, None] == grid.span[0]
    states = uniform < np.where(begins, first_chance, after_no)
    flips_again = uniform < np.where(begins, first_chance, after_yes)
    for t in range(1, grid.frames):
        states[t] = np.where(states[t - 1], flips_again[t], states[t])
    return np.asarray(states[grid.frame, grid.column])


def _size_errors(grid: Grid, draws: Draws, new_normal: Floats) -> Floats:
    """Return errors of length, width, height [R, 3] m.

    ``new_normal`` [R, 3]: normal numbers that are new in every frame.
    """
    constant_normal = grid.constant(
        draws,
        "size",
        lambda keys: draws.normal(NoiseKind.SIZE, Component.BIAS, of_axes(keys)).T,
    )
    white_share = grid.of_rows("size.white")[:, None]
    mixed_normal = (
        np.sqrt(1 - white_share) * constant_normal.T[grid.column]
        + np.sqrt(white_share) * new_normal
    )
    return grid.of_rows("size.mean") + grid.of_rows("size.deviation") * mixed_normal


def of_axes(keys: Keys) -> Keys:
    """Return keys [n, 3] of length, width and height."""
    return keys_of(keys[:, None], _AXES)
