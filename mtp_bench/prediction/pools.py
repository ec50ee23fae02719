"""Pools of samples in the form of the samplers' kernels.

Futures with constant acceleration have six coordinates each in place of T positions,
with the same distances.
"""

from functools import lru_cache

import numpy as np

from ..core import Floats, Ints
from ..tracking import part

DEGREES = 3  # coordinates of a quadratic polynomial
# squared error of the coordinates as a share of a pool's squared extent: a millionth
# of the extent
_MAX_SQUARED_ERROR = 1e-12


@part
def existing(log_weight: Floats, rows: Ints) -> int:
    """Write indices of the samples with a finite log-weight [S] to ``rows`` [S].

    Returns how many there are.
    """
    count = 0
    for sample in range(len(log_weight)):
        if np.isfinite(log_weight[sample]):
            rows[count] = sample
            count += 1
    return count


@part
def pass_on(
    points: Floats,
    log_weight: Floats,
    rows: Ints,
    count: int,
    chosen: Floats,
    chosen_log_weight: Floats,
) -> None:
    """Copy the ``count`` samples in ``rows`` to the first rows of ``chosen`` [k, d].

    The other rows are marked absent.
    """
    for j in range(len(chosen)):
        if j < count:
            chosen_log_weight[j] = log_weight[rows[j]]
        else:
            chosen_log_weight[j] = -np.inf
        for axis in range(chosen.shape[1]):
            chosen[j, axis] = points[rows[j], axis] if j < count else 0.0


@part
def masses(log_weight: Floats, rows: Ints, count: int, mass: Floats) -> float:
    """Return the log of the total weight of the ``count`` samples in ``rows``.

    Writes normalised weights to ``mass`` [count]. Weights are relative to the heaviest:
    an object of unlikely hypotheses alone must not vanish by underflow.
    """
    heaviest = -np.inf
    for i in range(count):
        heaviest = max(heaviest, log_weight[rows[i]])
    total = 0.0
    for i in range(count):
        mass[i] = np.exp(log_weight[rows[i]] - heaviest)
        total += mass[i]
    for i in range(count):
        mass[i] /= total
    return float(heaviest + np.log(total))


def as_points(pool: Floats, log_weight: Floats) -> tuple[Floats, Floats]:
    """Return the pool [O, S, T, 2] as points [O, S, 2 T], and its log-weights [O, S].

    Both are contiguous and writable for kernels.
    """
    flat = pool.reshape(*pool.shape[:2], 2 * pool.shape[2])
    points = np.require(flat, np.float64, ["C", "W"])
    return points, np.require(log_weight, np.float64, ["C", "W"])


@lru_cache
def polynomials(future: int) -> Floats:
    """Return orthonormal polynomials [3, T] of degree 0, 1 and 2.

    They are over T equally spaced times, at least 3.
    """
    basis = np.zeros((DEGREES, future))
    for degree in range(DEGREES):
        basis[degree] = (np.arange(future) - 0.5 * (future - 1)) ** degree
        # cumsum adds one by one, so that the bits are the same everywhere
        for lower in range(degree):
            basis[degree] -= np.cumsum(basis[degree] * basis[lower])[-1] * basis[lower]
        basis[degree] /= np.sqrt(np.cumsum(basis[degree] ** 2)[-1])
    return basis


@part
def write_motions(points: Floats, rows: Ints, basis: Floats, motion: Floats) -> bool:
    """Write six coordinates of points and return whether they suffice.

    ``motion`` [n, 6]: x and y of each degree of ``basis`` [3, T], relative to the first
    point. They suffice if they determine the points: those of ``points`` [S, 2 T] in
    ``rows`` [n].
    """
    max_error = 0.0
    max_square = 0.0
    first = points[rows[0]]
    for i in range(len(motion)):
        point = points[rows[i]]
        x0 = 0.0
        x1 = 0.0
        x2 = 0.0
        y0 = 0.0
        y1 = 0.0
        y2 = 0.0
        square = 0.0
        for t in range(basis.shape[1]):
            x = point[2 * t] - first[2 * t]
            y = point[2 * t + 1] - first[2 * t + 1]
            x0 = x0 + basis[0, t] * x
            y0 = y0 + basis[0, t] * y
            x1 = x1 + basis[1, t] * x
            y1 = y1 + basis[1, t] * y
            x2 = x2 + basis[2, t] * x
            y2 = y2 + basis[2, t] * y
            square += x * x + y * y
        motion[i, 0] = x0
        motion[i, 1] = y0
        motion[i, 2] = x1
        motion[i, 3] = y1
        motion[i, 4] = x2
        motion[i, 5] = y2
        # the basis is orthonormal: what the coordinates leave of the square
        error = square - (x0 * x0 + y0 * y0 + x1 * x1 + y1 * y1 + x2 * x2 + y2 * y2)
        max_error = max(max_error, error)
        max_square = max(max_square, square)
    return max_error <= _MAX_SQUARED_ERROR * max_square


@part
def from_motions(motion: Floats, basis: Floats, origin: Floats, point: Floats) -> None:
    """Write points [k, 2 T] of coordinates [k, 6].

    The coordinates are relative to ``origin`` [2 T].
    """
    for j in range(len(point)):
        for t in range(basis.shape[1]):
            for axis in range(2):
                coordinate = origin[2 * t + axis]
                for degree in range(DEGREES):
                    coordinate += basis[degree, t] * motion[j, 2 * degree + axis]
                point[j, 2 * t + axis] = coordinate
