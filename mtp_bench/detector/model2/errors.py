"""Errors of detected boxes: position, heading, size, height and velocity."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ...geometry import rotate, wrap_angle
from ...types import Bools, Floats
from ..chains import at_period, stationary, two_state
from ..estimates import FARTHEST, ROBUST_T4, sized
from .draws import Draws, Grid, Kind, Part, keys_of
from .neighbours import Neighbours
from .profile import ClassNoise, PositionNoise

_LATENT = np.linspace(-5.0, 5.0, 1001)  # beyond, tails are as heavy as at the end


def position_errors(
    grid: Grid, distance: Floats, toward: Floats, quality: Floats, neighbours: Neighbours, draws: Draws
) -> Floats:
    """Errors of the positions ``[R, 2]`` m of boxes at ``distance`` ``[R]`` m.

    ``toward`` ``[R]`` rad points from the sensor to them; ``quality`` ``[R]`` is the random part of their quality.
    """
    tails = _tails(grid, draws)

    def error(axis: Callable[[ClassNoise], PositionNoise], kind: Kind) -> Floats:
        latent = grid.latent(axis, neighbours, draws, kind)
        s0, s1, gain = grid.of_rows(lambda n: (axis(n).s0, axis(n).s1, axis(n).quality)).T
        scale = (s0 + s1 * distance / 10) * np.exp(-gain * quality)
        return np.asarray(np.clip(scale * tails * latent, -FARTHEST, FARTHEST))

    off = [error(lambda n: n.radial, Kind.RADIAL), error(lambda n: n.tangential, Kind.TANGENTIAL)]
    return rotate(np.stack(off, axis=-1), toward)


def _tails(grid: Grid, draws: Draws) -> Floats:
    """What makes Student's t of normal numbers ``[R]``; it lasts as the radial error does."""
    bias, ar, phi, nu = grid.of_objects(lambda n: (n.radial.bias, n.radial.ar, n.radial.phi, n.nu)).T
    lasts = bias + ar > 0  # else it is new in every frame
    latent = grid.lasting(bias / np.maximum(bias + ar, 1e-12), phi, draws, Kind.TAIL)
    if not lasts.all():
        latent = np.where(lasts[grid.column], latent, draws.normal(Kind.TAIL, Part.WHITE, grid.of_frames))
    factor = np.ones(len(latent))
    of_rows = nu[grid.column]
    for freedom in np.unique(nu):
        rows = of_rows == freedom
        factor[rows] = np.interp(latent[rows], _LATENT, _mixing(float(freedom)))
    return factor


@lru_cache(maxsize=256)
def _mixing(nu: float) -> Floats:
    """Root of nu over a chi-squared number whose rank is that of the normal one `_LATENT`, from above."""
    from scipy.special import chdtri, ndtr

    return np.asarray(np.sqrt(nu / chdtri(nu, ndtr(_LATENT))))


def estimated(true: Floats, off: Floats, grid: Grid, draws: Draws) -> Floats:
    """Boxes ``[R, 7]`` as the detector estimates ``true`` ones, ``off`` ``[R, 2]`` m from their places."""
    box = np.array(true, dtype=np.float64)
    box[:, :2] += off
    mean, deviation = grid.of_rows(lambda noise: noise.z).T
    box[:, 2] += mean + deviation * draws.normal(Kind.Z, Part.WHITE, grid.of_frames)
    box[:, 3] = wrap_angle(box[:, 3] + _heading_error(grid, draws))
    box[:, 4:] = _sizes(box[:, 4:], grid, draws)
    return box


def velocities(true: Floats, grid: Grid, toward: Floats, draws: Draws) -> Floats:
    """Measured velocities ``[R, 2]`` m/s; NaN where the class has none or the truth is unknown."""
    deviation = grid.of_rows(lambda noise: np.nan if noise.velocity is None else noise.velocity)
    if np.isnan(deviation).all():
        return np.full(true.shape, np.nan)
    error = _components(draws, Kind.VELOCITY, Part.WHITE, grid, 2)
    return np.asarray(true + rotate(deviation[:, None] * error, toward))


def _components(draws: Draws, kind: Kind, part: Part, grid: Grid, count: int) -> Floats:
    """New normal numbers for every row ``[R, count]``."""
    return draws.normal(kind, part, keys_of(grid.of_frames[:, None], np.arange(count)[None, :]))


def _heading_error(grid: Grid, draws: Draws) -> Floats:
    """Error of the heading ``[R]``, radians, turns by pi included."""
    after_no = grid.of_objects(lambda noise: noise.heading.flip)
    after_yes = grid.of_objects(lambda noise: noise.heading.flip_again)
    flipped = np.pi * _flips(*at_period(after_no, after_yes, grid.steps), grid, draws)[grid.frame, grid.column]
    scale = grid.of_rows(lambda noise: noise.heading.scale) / ROBUST_T4
    return np.asarray(scale * _student4(grid, draws) + flipped)


def _flips(after_no: Floats, after_yes: Floats, grid: Grid, draws: Draws) -> Bools:
    """Whether headings are turned by pi ``[F, J]``."""
    if not after_no.any():
        return np.zeros((grid.frames, len(grid.ids)), dtype=bool)
    frame, column = grid.cells
    uniform = np.ones((grid.frames, len(grid.ids)))
    uniform[frame, column] = draws.uniform(Kind.FLIP, Part.PUSH, grid.of_cells)
    begins = np.zeros(uniform.shape, dtype=bool)
    begins[grid.span[0] % grid.frames, np.arange(len(grid.ids))] = True
    return two_state((stationary(after_no, after_yes), after_no, after_yes), begins, uniform)


def _student4(grid: Grid, draws: Draws) -> Floats:
    """Student's t with 4 degrees of freedom ``[R]``: a normal number over the root of a chi-squared one."""
    first, second = (draws.uniform(Kind.HEADING, part, grid.of_frames) for part in (Part.PUSH, Part.OTHER))
    square = -0.5 * np.log(first * second)
    return np.asarray(draws.normal(Kind.HEADING, Part.WHITE, grid.of_frames) / np.sqrt(square))


def _sizes(true: Floats, grid: Grid, draws: Draws) -> Floats:
    """Estimated length, width, height ``[R, 3]``."""
    bias = draws.normal(Kind.SIZE, Part.BIAS, keys_of(grid.of_ids[:, None], np.arange(3)[None, :]))
    white = _components(draws, Kind.SIZE, Part.WHITE, grid, 3)
    share = grid.of_rows(lambda noise: noise.size.white)[:, None]
    latent = np.sqrt(1 - share) * bias[grid.column] + np.sqrt(share) * white
    error = grid.of_rows(lambda noise: noise.size.mean) + grid.of_rows(lambda noise: noise.size.deviation) * latent
    return sized(true, error)
