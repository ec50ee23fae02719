"""Sampler by weighted k-means: k samples that represent a pool.

Source: the paper, "Trajectory Sampling".

Compiled code clusters the pools of all objects without a distance matrix. Samples of
constant acceleration are clustered by six coordinates each, which have the same
distances as their T positions.
"""

import numpy as np

from ..core import Floats, Ints
from ..tracking import kernel, part
from .pools import (
    DEGREES,
    as_points,
    existing,
    from_motions,
    masses,
    pass_on,
    polynomials,
    write_motions,
)

_JUST_BELOW = 1.0 - 2.0**-53  # factor that gives the next smaller number
_BLOCK = 8  # chances that are summed at once
_AXES_AT_ONCE = 6  # in one pass over the points, which `_take_closer` writes out


@part
def _axis(point: Floats, axis: int) -> float:
    """Return a coordinate in single precision, 0 beyond the last."""
    value = point[axis] if axis < len(point) else 0.0
    return np.float32(value)  # type: ignore[return-value]


@part
def _take_closer(
    transposed: Floats,
    centre: Floats,
    j: int,
    distance: Floats,
    min_distance: Floats,
    nearest: Ints,
) -> None:
    """Give centre ``j`` the points that are closer than ``min_distance`` [S].

    These squared distances and ``nearest`` [S], numbers of centres, are updated in
    place; ``distance`` [S] is workspace, 0 at the start. The centre is [d], points are [D, S]. The long
    axis is innermost, for vector units; D is d, filled up to a multiple of six with
    zeros.
    """
    last = len(transposed) - _AXES_AT_ONCE
    if last > 0:
        for s in range(len(distance)):
            distance[s] = np.float32(0.0)
    number = np.int32(j)  # as wide as the distances, for vector units
    for axis in range(0, len(transposed), _AXES_AT_ONCE):
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
            total = distance[s] + (
                (d0 * d0 + d1 * d1) + (d2 * d2 + d3 * d3) + (d4 * d4 + d5 * d5)
            )
            if axis < last:
                distance[s] = total
            else:
                is_nearer = total < min_distance[s]
                # a conditional store would be slow
                min_distance[s] = np.minimum(total, min_distance[s])
                nearest[s] = number if is_nearer else nearest[s]


@part
def _draw_index(chance: Floats, block_sum: Floats, uniform: float) -> int:
    """Draw an index in proportion to ``chance`` [8 B].

    The index is -1 if all chances are 0. ``uniform`` in [0, 1) decides. ``block_sum``
    [B] is workspace: sums of blocks are independent of each other, and one block is
    searched.
    """
    total = 0.0
    for b in range(len(block_sum)):
        p = chance[_BLOCK * b : _BLOCK * (b + 1)]
        block_sum[b] = ((p[0] + p[1]) + (p[2] + p[3])) + ((p[4] + p[5]) + (p[6] + p[7]))
    for b in range(len(block_sum)):
        total += block_sum[b]
    # Below the total and not equal to any partial sum: a point without a chance is
    # never picked.
    mark = min(uniform * total, total * _JUST_BELOW)
    partial_sum = 0.0
    chosen = -1
    for b in range(len(block_sum)):
        if partial_sum + block_sum[b] <= mark:
            partial_sum += block_sum[b]
            continue
        for s in range(_BLOCK * b, _BLOCK * (b + 1)):
            partial_sum += chance[s]
            # Rounded sums may never pass the mark: then the last one with a chance.
            if chance[s] > 0.0:
                chosen = s
            if partial_sum > mark:
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
    min_distance: Floats,
    nearest: Ints,
    chance: Floats,
    block_sum: Floats,
) -> None:
    """Draw centres [k, d] far from each other, by ``uniform`` [k].

    Chances are in proportion to weight x squared distance from the nearest centre so
    far. ``points`` [n, d], weighted [n], and ``transposed`` [D, n]. ``nearest`` [n] is
    written: the centre of every point, the first of equally near ones. Workspace:
    ``chance`` [8 B], 0 from n on; ``block_sum`` [B]; the rest [n].
    """
    for s in range(len(weight)):
        min_distance[s] = np.float32(np.inf)
        chance[s] = weight[s]
    for j in range(len(centre)):
        chosen = _draw_index(chance, block_sum, uniform[j])
        # all points sit on a centre already: draw by weight, the centre repeats
        if chosen < 0:
            for s in range(len(weight)):
                chance[s] = weight[s]
            chosen = _draw_index(chance, block_sum, uniform[j])
        for axis in range(points.shape[1]):
            centre[j, axis] = points[chosen, axis]
        _take_closer(transposed, centre[j], j, distance, min_distance, nearest)
        for s in range(len(weight)):
            chance[s] = weight[s] * min_distance[s]


@part
def _assign(
    transposed: Floats,
    centre: Floats,
    distance: Floats,
    min_distance: Floats,
    nearest: Ints,
) -> bool:
    """Assign points to their nearest centre and return whether any changed.

    The first of equally near ones counts. ``nearest`` [2, S] is written: centres of
    the points now, and those before.
    """
    new_nearest = nearest[0]
    old_nearest = nearest[1]
    for s in range(len(distance)):
        old_nearest[s] = new_nearest[s]
        min_distance[s] = np.float32(np.inf)
    for j in range(len(centre)):
        _take_closer(transposed, centre[j], j, distance, min_distance, new_nearest)
    changed_bits = 0  # without a branch, for vector units
    for s in range(len(distance)):
        changed_bits |= new_nearest[s] ^ old_nearest[s]
    return changed_bits != 0


@part
def _sum_shares(weight: Floats, nearest: Ints, share: Floats) -> None:
    """Write the total weight [k] of the points of each centre."""
    for j in range(len(share)):
        share[j] = 0.0
    for s in range(len(weight)):
        share[nearest[s]] += weight[s]


@part
def _move(
    points: Floats, weight: Floats, nearest: Ints, centre: Floats, share: Floats
) -> None:
    """Move every centre to the mean of its points.

    Writes the weight of its points to ``share`` [k]. A centre without points stays.
    """
    _sum_shares(weight, nearest, share)
    for j in range(len(centre)):
        if share[j] > 0.0:
            for axis in range(centre.shape[1]):
                centre[j, axis] = 0.0
    for s in range(len(weight)):
        if weight[s] > 0.0:
            portion = weight[s] / share[nearest[s]]
            for axis in range(centre.shape[1]):
                centre[nearest[s], axis] += portion * points[s, axis]


@part
def _write_offsets(points: Floats, rows: Ints, offset: Floats) -> None:
    """Write the points in ``rows`` [n] relative to the first, [n, d]."""
    for i in range(len(offset)):
        for axis in range(offset.shape[1]):
            offset[i, axis] = points[rows[i], axis] - points[rows[0], axis]


@part
def _transpose(points: Floats, transposed: Floats) -> None:
    """Write points [n, d] as [D, n], in single precision.

    Axes from d on are filled with zeros, see `_take_closer`.
    """
    transposed[:] = 0.0
    for axis in range(points.shape[1]):
        for s in range(len(points)):
            transposed[axis, s] = points[s, axis]


@part
def _find_clusters(
    points: Floats,
    weight: Floats,
    uniform: Floats,
    iterations: int,
    centre: Floats,
    share: Floats,
) -> None:
    """Write centres [k, d] and their shares of the weight [k].

    Points [n, d], weighted [n], are relative to one of them, for single precision.
    """
    n, d = points.shape
    # d, rounded up to a multiple of six
    axes = (d + _AXES_AT_ONCE - 1) // _AXES_AT_ONCE * _AXES_AT_ONCE
    transposed = np.empty((axes, n), np.float32)
    distance = np.zeros(n, np.float32)
    min_distance = np.empty(n, np.float32)
    nearest = np.zeros((2, n), np.int32)
    blocks = (n + _BLOCK - 1) // _BLOCK
    chance = np.zeros(_BLOCK * blocks)
    block_sum = np.empty(blocks)
    _transpose(points, transposed)
    _seed(
        points,
        transposed,
        weight,
        uniform,
        centre,
        distance,
        min_distance,
        nearest[0],
        chance,
        block_sum,
    )
    for _ in range(iterations):
        _move(points, weight, nearest[0], centre, share)
        if not _assign(transposed, centre, distance, min_distance, nearest):
            break
    _sum_shares(weight, nearest[0], share)


@part
def _cluster_pool(
    points: Floats,
    rows: Ints,
    weight: Floats,
    uniform: Floats,
    iterations: int,
    basis: Floats,
    centre: Floats,
    share: Floats,
) -> None:
    """Write centres [k, d] and shares [k] of a pool.

    Its points are those in ``rows`` [n], weighted [n]. ``basis``: see `k_means`.
    """
    origin = points[rows[0]]
    motion = np.zeros((len(rows), 2 * DEGREES))
    # six coordinates in place of 2 T, where they determine the points
    if basis.shape[1] and write_motions(points, rows, basis, motion):
        motion_centre = np.zeros((len(centre), 2 * DEGREES))
        _find_clusters(motion, weight, uniform, iterations, motion_centre, share)
        from_motions(motion_centre, basis, origin, centre)
        return
    offset = np.zeros((len(rows), len(origin)))
    _write_offsets(points, rows, offset)
    _find_clusters(offset, weight, uniform, iterations, centre, share)
    for j in range(len(centre)):
        for axis in range(len(origin)):
            centre[j, axis] += origin[axis]


@kernel(
    "void(f8[:, :, ::1], f8[:, ::1], f8[:, ::1], i8, f8[:, ::1], "
    "f8[:, :, ::1], f8[:, ::1])"
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
    """Write centres and log-shares of pools.

    Centres are [O, k, d], log-shares [O, k], pools [O, S, d], ``log_weight`` [O, S].
    k-means++ draws seeds by ``uniform`` [crowded objects, k], then at most
    ``iterations`` of Lloyd's algorithm follow (Arthur, Vassilvitskii 2007). A pool of
    at most k existing samples is copied; others are crowded. ``basis``: `polynomials`,
    or [3, 0] to cluster by positions.
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
        _cluster_pool(
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
    """Centres of weighted k-means++ clusters, for all objects of a frame at once.

    ``iterations`` of Lloyd's algorithm follow the seeding; 0 returns the seeds, which
    are samples of the pool (Arthur, Vassilvitskii 2007).
    """

    def __init__(self, iterations: int = 3) -> None:
        self._iterations = iterations

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """Find ``k`` centres of the pool of each object.

        Returns centres [O, k, T, 2] and log-weights [O, k]. The pool is [O, S, T, 2],
        weighted ``log_weight`` [O, S]. A sample with log-weight -inf does not exist. A
        pool of at most k existing samples is copied, and filled up with ones that do
        not exist. Objects may come in one call or in several: random numbers are drawn
        object by object.
        """
        objects, _, future, _ = pool.shape
        centre = np.empty((objects, k, 2 * future))
        log_share = np.empty((objects, k))
        is_crowded = np.isfinite(log_weight).sum(axis=1) > k
        uniform = rng.random((np.count_nonzero(is_crowded), k))
        basis: Floats = np.zeros((DEGREES, 0))
        if future > DEGREES:  # else polynomials save no coordinates
            basis = polynomials(future)
        k_means(
            *as_points(pool, log_weight),
            uniform,
            self._iterations,
            basis,
            centre,
            log_share,
        )
        return centre.reshape(objects, k, future, 2), log_share
