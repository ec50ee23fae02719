"""Sampler by weighted k-means: k samples that represent a pool (paper, "Trajectory Sampling").

Compiled code clusters the pools of all objects without a distance matrix. Samples of constant acceleration are
clustered by six coordinates each, which have the same distances as their T positions.
"""

from functools import lru_cache

import numpy as np

from ..core import Floats, Ints
from ..tracking import kernel, part
from .pools import as_points, existing, masses, pass_on

_JUST_BELOW = 1.0 - 2.0**-53  # factor to the next number below, up to half a unit
_BLOCK = 8  # chances that are summed at once
_DEGREES = 3  # coordinates of a quadratic polynomial
_AT_ONCE = 6  # axes in one pass over the points, which `_closer` writes out
_EXACT = 1e-12  # squared error of the coordinates as a share of a pool's squared extent: a millionth of it


@part
def _axis(point: Floats, axis: int) -> float:
    return np.float32(point[axis] if axis < len(point) else 0.0)  # type: ignore[return-value]


@part
def _closer(
    transposed: Floats,
    centre: Floats,
    j: int,
    distance: Floats,
    least: Floats,
    nearest: Ints,
) -> None:
    """Give centre ``j`` [d] the points [D, S] that are nearer to it than the squared distances ``least`` [S].

    The long axis is innermost, for vector units; D is d, filled up to a multiple of six with zeros.
    """
    for s in range(len(distance)):
        distance[s] = np.float32(0.0)
    for axis in range(0, len(transposed), _AT_ONCE):
        c0 = _axis(centre, axis)
        c1 = _axis(centre, axis + 1)
        c2 = _axis(centre, axis + 2)
        c3 = _axis(centre, axis + 3)
        c4 = _axis(centre, axis + 4)
        c5 = _axis(centre, axis + 5)
        for s in range(len(distance)):
            d0 = transposed[axis, s] - c0
            d1 = transposed[axis + 1, s] - c1
            d2 = transposed[axis + 2, s] - c2
            d3 = transposed[axis + 3, s] - c3
            d4 = transposed[axis + 4, s] - c4
            d5 = transposed[axis + 5, s] - c5
            distance[s] += (
                (d0 * d0 + d1 * d1) + (d2 * d2 + d3 * d3) + (d4 * d4 + d5 * d5)
            )
    number = np.int32(j)  # as wide as the distances, for vector units
    for s in range(len(distance)):
        nearer = distance[s] < least[s]
        least[s] = distance[s] if nearer else least[s]
        nearest[s] = number if nearer else nearest[s]


@part
def _drawn(chance: Floats, block: Floats, uniform: float) -> int:
    """The place that a uniform number draws in proportion to ``chance`` [8 B]; -1 if all chances are 0.

    Sums of blocks [B] are independent of each other, and few blocks are searched.
    """
    total = 0.0
    for b in range(len(block)):
        p = chance[_BLOCK * b : _BLOCK * (b + 1)]
        block[b] = ((p[0] + p[1]) + (p[2] + p[3])) + ((p[4] + p[5]) + (p[6] + p[7]))
    for b in range(len(block)):
        total += block[b]
    # Below the total and not equal to any partial sum: a point without a chance is never picked.
    mark = min(uniform * total, total * _JUST_BELOW)
    partial = 0.0
    chosen = -1
    for b in range(len(block)):
        if partial + block[b] <= mark:
            partial += block[b]
            continue
        for s in range(_BLOCK * b, _BLOCK * (b + 1)):
            partial += chance[s]
            chosen = (
                s if chance[s] > 0.0 else chosen
            )  # the last one, where sums round otherwise than the block's
            if partial > mark:
                break
        break
    return chosen


@part
def _seed(
    points: Floats,
    transposed: Floats,
    weight: Floats,
    uniform: Floats,
    centre: Floats,
    distance: Floats,
    least: Floats,
    nearest: Ints,
    chance: Floats,
    block: Floats,
) -> None:
    """Draw centres [k, d] in proportion to weight x squared distance from the centres so far, by ``uniform`` [k].

    ``points`` [n, d], weighted [n], and ``transposed`` [D, n]. Every point then belongs to its ``nearest`` centre [n],
    the first of equally near ones. Of the workspace ``chance`` [8 B] begins with zeros, ``block`` is [B], the rest [n].
    """
    for s in range(len(weight)):
        least[s] = np.float32(np.inf)
        chance[s] = weight[s]
    for j in range(len(centre)):
        chosen = _drawn(chance, block, uniform[j])
        if (
            chosen < 0
        ):  # all points sit on a centre already: draw by weight, the centre repeats
            for s in range(len(weight)):
                chance[s] = weight[s]
            chosen = _drawn(chance, block, uniform[j])
        for axis in range(points.shape[1]):
            centre[j, axis] = points[chosen, axis]
        _closer(transposed, centre[j], j, distance, least, nearest)
        for s in range(len(weight)):
            chance[s] = weight[s] * least[s]


@part
def _assign(
    transposed: Floats, centre: Floats, distance: Floats, least: Floats, nearest: Ints
) -> bool:
    """Assign every point to its nearest centre, the first of equally near ones; True if any changed.

    ``nearest`` [2, S]: centres of the points now, and before.
    """
    now = nearest[0]
    before = nearest[1]
    for s in range(len(distance)):
        before[s] = now[s]
        least[s] = np.float32(np.inf)
    for j in range(len(centre)):
        _closer(transposed, centre[j], j, distance, least, now)
    changed = 0
    for s in range(len(distance)):
        changed |= now[s] ^ before[s]
    return changed != 0


@part
def _shares(weight: Floats, nearest: Ints, share: Floats) -> None:
    """Write the weight of the points of each centre."""
    for j in range(len(share)):
        share[j] = 0.0
    for s in range(len(weight)):
        share[nearest[s]] += weight[s]


@part
def _move(
    points: Floats, weight: Floats, nearest: Ints, centre: Floats, share: Floats
) -> None:
    """Move every centre to the mean of its points; a centre without points stays. ``share``: their weight."""
    _shares(weight, nearest, share)
    for j in range(len(centre)):
        for axis in range(centre.shape[1]):
            centre[j, axis] = 0.0 if share[j] > 0.0 else centre[j, axis]
    for s in range(len(weight)):
        if weight[s] > 0.0:
            portion = weight[s] / share[nearest[s]]
            for axis in range(centre.shape[1]):
                centre[nearest[s], axis] += portion * points[s, axis]


@lru_cache
def polynomials(future: int) -> Floats:
    """Orthonormal polynomials [3, T] of degree 0, 1 and 2 over T equally spaced times; at least 3 times."""
    basis = np.zeros((_DEGREES, future))
    for degree in range(_DEGREES):
        basis[degree] = (np.arange(future) - 0.5 * (future - 1)) ** degree
        for lower in range(degree):
            basis[degree] -= np.cumsum(basis[degree] * basis[lower])[-1] * basis[lower]
        basis[degree] /= np.sqrt(np.cumsum(basis[degree] ** 2)[-1])
    return basis


@part
def _motions(points: Floats, rows: Ints, basis: Floats, motion: Floats) -> bool:
    """Write coordinates [n, 6] of the points [S, 2 T] in ``rows`` [n]; True if they determine the points.

    Position, velocity and acceleration of x and y, in turn, relative to the first point.
    """
    worst = 0.0
    extent = 0.0
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
        motion[i, 0], motion[i, 1], motion[i, 2] = x0, y0, x1
        motion[i, 3], motion[i, 4], motion[i, 5] = y1, x2, y2
        rest = square - (x0 * x0 + y0 * y0 + x1 * x1 + y1 * y1 + x2 * x2 + y2 * y2)
        worst = max(worst, rest)
        extent = max(extent, square)
    return worst <= _EXACT * extent


@part
def _offsets(points: Floats, rows: Ints, offset: Floats) -> None:
    """Write the points [S, d] in ``rows`` [n] relative to the first of them: [n, d]."""
    for i in range(len(offset)):
        for axis in range(offset.shape[1]):
            offset[i, axis] = points[rows[i], axis] - points[rows[0], axis]


@part
def _transpose(points: Floats, transposed: Floats) -> None:
    """Write points [n, d], relative to one of them, as [d, n] in single precision, which halves the memory."""
    for s in range(len(points)):
        for axis in range(len(transposed)):
            transposed[axis, s] = points[s, axis] if axis < points.shape[1] else 0.0


@part
def _from_motions(motion: Floats, basis: Floats, origin: Floats, found: Floats) -> None:
    """Write points [k, 2 T] of coordinates [k, 6] relative to ``origin`` [2 T]."""
    for j in range(len(found)):
        for t in range(basis.shape[1]):
            for axis in range(2):
                place = origin[2 * t + axis]
                for degree in range(_DEGREES):
                    place += basis[degree, t] * motion[j, 2 * degree + axis]
                found[j, 2 * t + axis] = place


@part
def _clusters(
    points: Floats,
    weight: Floats,
    uniform: Floats,
    iterations: int,
    centre: Floats,
    share: Floats,
) -> None:
    """Write centres [k, d] and shares of the weight [k] of points [n, d] weighted [n], relative to one of them."""
    n, d = points.shape
    transposed = np.empty(((d + _AT_ONCE - 1) // _AT_ONCE * _AT_ONCE, n), np.float32)
    distance = np.empty(n, np.float32)
    least = np.empty(n, np.float32)
    nearest = np.zeros((2, n), np.int32)
    blocks = (n + _BLOCK - 1) // _BLOCK
    chance = np.zeros(_BLOCK * blocks)
    block = np.empty(blocks)
    _transpose(points, transposed)
    _seed(
        points,
        transposed,
        weight,
        uniform,
        centre,
        distance,
        least,
        nearest[0],
        chance,
        block,
    )
    for _ in range(iterations):
        _move(points, weight, nearest[0], centre, share)
        if not _assign(transposed, centre, distance, least, nearest):
            break
    _shares(weight, nearest[0], share)


@part
def _clusters_of(
    points: Floats,
    rows: Ints,
    weight: Floats,
    uniform: Floats,
    iterations: int,
    basis: Floats,
    centre: Floats,
    share: Floats,
) -> None:
    """Write centres [k, d] and shares [k] of the points in ``rows`` [n], weighted [n]; ``basis``: [3, T] or [3, 0]."""
    origin = points[rows[0]]
    motion = np.zeros((len(rows), 2 * _DEGREES))
    if basis.shape[1] and _motions(points, rows, basis, motion):
        found = np.zeros((len(centre), 2 * _DEGREES))
        _clusters(motion, weight, uniform, iterations, found, share)
        _from_motions(found, basis, origin, centre)
        return
    offset = np.zeros((len(rows), len(origin)))
    _offsets(points, rows, offset)
    _clusters(offset, weight, uniform, iterations, centre, share)
    for j in range(len(centre)):
        for axis in range(len(origin)):
            centre[j, axis] += origin[axis]


@kernel(
    "void(f8[:, :, ::1], f8[:, ::1], f8[:, ::1], i8, f8[:, ::1], f8[:, :, ::1], f8[:, ::1])"
)
def k_means(
    pool: Floats,
    log_weight: Floats,
    uniform: Floats,
    iterations: int,
    basis: Floats,
    centre: Floats,
    log_share: Floats,
) -> None:
    """Write centres [O, k, d] and log-shares of the weight [O, k], of pools [O, S, d] weighted [O, S].

    Seeds of k-means++, for uniform numbers [crowded objects, k], then at most ``iterations`` of Lloyd's algorithm
    (Arthur, Vassilvitskii 2007). A pool of at most k existing samples is copied. ``basis``: `polynomials`, or [3, 0].
    """
    size = pool.shape[1]
    k = centre.shape[1]
    crowded = 0
    rows = np.empty(size, np.int64)
    mass = np.empty(size)
    share = np.empty(k)
    for o in range(len(pool)):
        n = existing(log_weight[o], rows)
        if n <= k:
            pass_on(pool[o], log_weight[o], rows, n, centre[o], log_share[o])
            continue
        masses(log_weight[o], rows, n, mass)
        _clusters_of(
            pool[o],
            rows[:n],
            mass[:n],
            uniform[crowded],
            iterations,
            basis,
            centre[o],
            share,
        )
        crowded += 1
        for j in range(k):
            log_share[o, j] = np.log(share[j]) if share[j] > 0.0 else -np.inf


class KMeansSampler:
    """Centres of weighted k-means++ clusters, for all objects of a frame at once (Arthur, Vassilvitskii 2007).

    ``iterations`` of Lloyd's algorithm follow the seeding; 0 returns the seeds, which are samples of the pool.
    """

    def __init__(self, iterations: int = 3) -> None:
        self._iterations = iterations

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """``k`` centres [O, k, T, 2] and log-weights [O, k] for the pool [O, S, T, 2] weighted ``log_weight`` [O, S].

        A sample with log-weight -inf does not exist. A pool of at most k existing samples is copied, and filled up with
        ones that do not exist. Objects may come in one call or in several: random numbers are drawn object by object.
        """
        objects, _, future, _ = pool.shape
        centre = np.empty((objects, k, 2 * future))
        weight = np.empty((objects, k))
        uniform = rng.random(
            (np.count_nonzero(np.isfinite(log_weight).sum(axis=1) > k), k)
        )
        basis = polynomials(future) if future > _DEGREES else np.zeros((_DEGREES, 0))
        k_means(
            *as_points(pool, log_weight),
            uniform,
            self._iterations,
            basis,
            centre,
            weight,
        )
        return centre.reshape(objects, k, future, 2), weight
