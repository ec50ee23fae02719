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
from .profile import ClassNoise

FARTHEST = (
    2.0  # m: a larger position error would turn it into another object's detection
)
ROBUST_T4 = (
    1.4826 * 0.7406970841
)  # robust standard deviation of Student's t with 4 degrees of freedom
_SMALLEST = (
    0.2,
    0.3,
)  # m and share of the true size: the larger one is the least estimated side
_KINDS = NoiseKind.RADIAL, NoiseKind.TANGENTIAL, NoiseKind.TAIL
_NEW = *_KINDS, NoiseKind.Z, NoiseKind.HEADING
_OF_ROWS = (
    *parts(Component.WHITE, *_NEW),
    *parts(Component.PUSH, _NEW[-1]),
    *parts(Component.OTHER, _NEW[-1]),
)
_OF_AXES = parts(Component.WHITE, NoiseKind.SIZE, NoiseKind.VELOCITY)
_SCALES = (
    "radial.s0 radial.s1 radial.quality tangential.s0 tangential.s1 tangential.quality"
)
_AXES = np.arange(3)
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
    velocity: (
        Floats  # [R, 2] m/s, along and across the line of sight; NaN where not measured
    )


def draw_errors(
    grid: Grid, neighbours: Neighbours | None, draws: Draws, rows: Ints | None
) -> BoxErrors:
    """Draw the errors of all rows of a grid, or of some ``rows``; ``neighbours``, if any, share the lasting ones."""
    if rows is not None and grid.memory is None and neighbours is None:
        grid, rows = grid.select(rows), None
    lasting, flipped = (
        grid.lasting(_memories, neighbours, draws, _KINDS),
        _flips(grid, draws),
    )
    if rows is not None:
        grid, lasting, flipped = grid.select(rows), lasting[:, rows], flipped[rows]
    number = draws.uniforms(_OF_ROWS, grid.row_keys)
    new, push = ndtri(number[: len(_NEW)]), number[len(_NEW) :]
    radial, tangential, tail = grid.with_new(lasting, new[:3], _memories)
    scale, (mean, deviation) = grid.of_rows(_SCALES), grid.of_rows("z").T
    student_t4 = new[4] / np.sqrt(
        -0.5 * np.log(push[0] * push[1])
    )  # a normal number over the root of chi-squared
    turn = grid.of_rows("heading.scale") / ROBUST_T4 * student_t4 + np.pi * flipped
    latent, z = np.stack([radial, tangential], axis=-1), mean + deviation * new[3]
    size, velocity = ndtri(draws.uniforms(_OF_AXES, of_axes(grid.row_keys)))
    size, velocity = (
        _size_errors(grid, draws, size),
        grid.of_rows("velocity")[:, None] * velocity[:, :2],
    )
    return BoxErrors(
        latent,
        _tail_factors(grid, tail),
        scale.reshape(-1, 2, 3),
        z,
        turn,
        size,
        velocity,
    )


def _memories(noise: ClassNoise) -> tuple[Shares, ...]:
    """Memories of the position errors, and of their tails, which are as the radial error or new in every frame."""
    radial = shares_of(noise.radial)
    tail = radial[0], radial[1], 0.0, float(noise.radial.bias + noise.radial.ar <= 0)
    return radial, shares_of(noise.tangential), tail


def detected_boxes(
    box: Floats,
    velocity: Floats,
    errors: BoxErrors,
    distance: Floats,
    direction: Floats,
    quality: Floats,
) -> tuple[Floats, Floats]:
    """Detected boxes ``[R, 7]`` and velocities ``[R, 2]`` of true ones at ``distance`` ``[R]`` m.

    ``direction`` ``[R]`` rad points from the sensor to them; ``quality`` ``[R]`` is the random part of their quality.
    Velocities are NaN where the class has none or the true one is unknown.
    """
    s0, s1, gain = errors.scale[..., 0], errors.scale[..., 1], errors.scale[..., 2]
    scale = (s0 + s1 * distance[:, None] / 10) * np.exp(-gain * quality[:, None])
    offset = np.clip(scale * errors.tail[:, None] * errors.latent, -FARTHEST, FARTHEST)
    found, size = box.copy(), box[:, 4:]
    offset, turned = rotate(np.array([offset, errors.velocity]), direction)
    found[:, :2] += offset
    found[:, 2] += errors.z
    found[:, 3] = wrap_angle(found[:, 3] + errors.turn)
    least = np.minimum(size, np.maximum(_SMALLEST[0], _SMALLEST[1] * size))
    found[:, 4:] = np.maximum(size + errors.size, least)
    return found, velocity + turned


def _tail_factors(grid: Grid, latent: Floats) -> Floats:
    """Factors ``[R]`` that turn normal numbers into Student's t, from normal numbers ``[R]``."""
    factor, row_nu = np.ones(len(latent)), grid.of_rows("nu")
    for freedom in {noise.nu for noise in grid.noise}:
        rows = (row_nu == freedom).nonzero()[0]
        factor[rows] = np.interp(
            latent[rows], _LATENT, _mixing_quantiles(float(freedom))
        )
    return factor


@lru_cache(maxsize=256)
def _mixing_quantiles(nu: float) -> Floats:
    """Square root of nu over a chi-squared number, at the ranks of `_LATENT` from above."""
    return np.asarray(np.sqrt(nu / chdtri(nu, ndtr(_LATENT))))


def _flips(grid: Grid, draws: Draws) -> Bools:
    """Mask of headings that are turned by pi ``[R]``: two-state Markov chains."""
    flip, flip_again = grid.of_noise("heading.flip heading.flip_again").T
    after_no, after_yes = at_period(flip, flip_again, grid.steps)
    if not (len(grid.ids) and after_no.any()):
        return np.zeros(len(grid.column), dtype=bool)
    first, after_no, after_yes = np.array(
        [stationary(after_no, after_yes), after_no, after_yes]
    )[:, grid.noise_number]
    uniform = draws.uniform(NoiseKind.FLIP, Component.PUSH, grid.cell_keys)
    if grid.memory is not None:
        name = draws.subject, NoiseKind.FLIP
        before = grid.memory.before(name, uniform.shape) > 0
        state = uniform < np.where(
            grid.span[0] == grid.memory.frame,
            first,
            np.where(before, after_yes, after_no),
        )
        grid.memory.series[name] = state.astype(np.float64)
        return np.asarray(state[grid.column])
    uniform, begins = (
        grid.on_grid(uniform, other=1.0),
        np.arange(grid.frames)[:, None] == grid.span[0] % grid.frames,
    )
    if_no, if_yes = (
        np.where(begins, uniform < first, uniform < chance)
        for chance in (after_no, after_yes)
    )
    states = if_no
    for t in range(1, grid.frames):
        states[t] = np.where(states[t - 1], if_yes[t], if_no[t])
    return np.asarray(states[grid.frame, grid.column])


def _size_errors(grid: Grid, draws: Draws, white: Floats) -> Floats:
    """Errors of length, width, height ``[R, 3]`` m from normal numbers that are new in every frame."""
    bias = grid.constant(
        draws,
        "size",
        lambda own: draws.normal(NoiseKind.SIZE, Component.BIAS, of_axes(own)).T,
    )
    share = grid.of_rows("size.white")[:, None]
    return grid.of_rows("size.mean") + grid.of_rows("size.deviation") * (
        np.sqrt(1 - share) * bias.T[grid.column] + np.sqrt(share) * white
    )


def of_axes(keys: Keys) -> Keys:
    """Keys ``[n, 3]`` of length, width and height."""
    return keys_of(keys[:, None], _AXES)
