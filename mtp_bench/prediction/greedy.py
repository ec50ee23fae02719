"""Greedy sampler: k samples that represent a pool, by a greedy weighted k-median.

It suits pools of learned modes: few, distinct and weighted. The chosen samples keep the
shape of a mode; the mean of a cluster would be a future that no mode has.
"""

import math

import numpy as np

from ..core import Floats, Ints
from ..tracking import kernel, part
from .pools import as_points, existing, masses, pass_on


@part
def _transpose(points: Floats, rows: Ints, transposed: Floats) -> None:
    """Write points [n, d] as [d, n], in single precision.

    They are those of ``points`` [S, d] in ``rows`` [n], relative to the first one.
    """
    for axis in range(len(transposed)):
        for i in range(len(rows)):
            transposed[axis, i] = points[rows[i], axis] - points[rows[0], axis]


@part
def _pairwise_distances(transposed: Floats, distance: Floats) -> None:
    """Write distances [n, n] of futures [2 T, n].

    They are summed over the T positions. Each pair is computed once.
    """
    for i in range(len(distance)):
        row = distance[i, i:]  # from 0 on: only then the loop is vectorised
        for j in range(len(row)):
            row[j] = np.float32(0.0)
        for axis in range(0, len(transposed), 2):
            x = transposed[axis, i:]
            y = transposed[axis + 1, i:]
            x_i = x[0]
            y_i = y[0]
            for j in range(len(row)):
                dx = x[j] - x_i
                dy = y[j] - y_i
                row[j] += math.sqrt(dx * dx + dy * dy)
        for j in range(i):
            distance[i, j] = distance[j, i]


@part
def _mean_distances(distance: Floats, mass: Floats, mean: Floats) -> None:
    """Write the mean distance [n], by mass, from each sample."""
    for c in range(len(mean)):
        mean[c] = 0.0
    for s in range(len(mass)):
        row = distance[s]
        weight = mass[s]
        for c in range(len(mean)):
            mean[c] += weight * row[c]


@part
def _lower_gains(
    row: Floats, mass: float, old_distance: float, new_distance: float, gain: Floats
) -> None:
    """Lower the gains [n] for a sample's nearer choice.

    ``row`` [n]: distances of the sample from all others. A chosen one is nearer to it.
    """
    zero = np.float32(0.0)
    for c in range(len(gain)):
        old_gain = old_distance - row[c]
        new_gain = new_distance - row[c]
        gain[c] -= mass * (
            (old_gain if old_gain > zero else zero)
            - (new_gain if new_gain > zero else zero)
        )


@part
def _choose_medoid(
    distance: Floats, mass: Floats, min_distance: Floats, gain: Floats
) -> int:
    """Return the weighted medoid, the first of equals.

    Writes distances [n] from it and gains [n] of a second choice.
    """
    _mean_distances(distance, mass, gain)
    medoid = 0
    for c in range(len(gain)):
        medoid = c if gain[c] < gain[medoid] else medoid
    for c in range(len(gain)):
        gain[c] = 0.0
        min_distance[c] = distance[medoid, c]
    zero: float = np.float32(0.0)  # type: ignore[assignment]  # single precision
    for s in range(len(mass)):
        _lower_gains(distance[s], -mass[s], min_distance[s], zero, gain)
    return medoid


@part
def _choose(
    distance: Floats,
    mass: Floats,
    chosen: Ints,
    min_distance: Floats,
    nearest: Ints,
    gain: Floats,
) -> int:
    """Choose samples that lower the mean distance and count them.

    Each lowers it most; the first of equals is chosen. ``distance`` [n, n], ``mass``
    [n]; ``chosen`` [k]: their indices; ``min_distance`` and ``nearest`` [n]: distance
    and number of the nearest chosen one; ``gain`` [n]: by how much each would lower the
    mean distance.
    """
    best = _choose_medoid(distance, mass, min_distance, gain)
    for s in range(len(mass)):
        nearest[s] = 0
    for j in range(len(chosen)):
        chosen[j] = best
        for s in range(len(mass)):
            new_distance = distance[best, s]
            if new_distance < min_distance[s]:
                _lower_gains(distance[s], mass[s], min_distance[s], new_distance, gain)
                min_distance[s] = new_distance
                nearest[s] = j
            # itself and its equals, whose gain may differ from 0 by rounding
            if new_distance == 0.0:
                gain[s] = -np.inf
        for c in range(len(gain)):
            best = c if gain[c] > gain[best] else best
        if gain[best] <= 0.0:
            return j + 1
    return len(chosen)


@part
def _weigh(
    mass: Floats, nearest: Ints, count: int, log_total: float, log_weight: Floats
) -> None:
    """Write log-weights [k] of the ``count`` chosen samples.

    The weight is that of the samples that are nearest to each.
    """
    for j in range(len(log_weight)):
        log_weight[j] = 0.0
    for s in range(len(mass)):
        log_weight[nearest[s]] += mass[s]
    for j in range(len(log_weight)):
        if j < count and log_weight[j] > 0.0:
            log_weight[j] = log_total + np.log(log_weight[j])
        else:
            log_weight[j] = -np.inf


@kernel("void(f8[:, :, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, ::1])")
def k_medians(
    pool: Floats, log_weight: Floats, chosen: Floats, chosen_log_weight: Floats
) -> None:
    """Choose samples [O, k, d] from pools [O, S, d].

    Samples are weighted [O, S], and the chosen ones [O, k]; d = 2 T. A pool of at most
    k existing samples is copied.
    """
    size = pool.shape[1]
    axes = pool.shape[2]
    k = chosen.shape[1]
    rows = np.empty(size, np.int64)
    mass = np.empty(size)
    chosen_rows = np.empty(k, np.int64)
    min_distance = np.empty(size, np.float32)
    nearest = np.empty(size, np.int64)
    gain = np.empty(size)
    workspace = np.empty(size * max(size, axes) * 2, np.float32)
    for o in range(len(pool)):
        n = existing(log_weight[o], rows)
        if n <= k:
            pass_on(pool[o], log_weight[o], rows, n, chosen[o], chosen_log_weight[o])
            continue
        log_total = masses(log_weight[o], rows, n, mass)
        transposed = workspace[: axes * n].reshape(axes, n)
        distance = workspace[axes * n : axes * n + n * n].reshape(n, n)
        _transpose(pool[o], rows[:n], transposed)
        _pairwise_distances(transposed, distance)
        count = _choose(
            distance, mass[:n], chosen_rows, min_distance[:n], nearest[:n], gain[:n]
        )
        for j in range(count):
            chosen_rows[j] = rows[chosen_rows[j]]
        pass_on(
            pool[o], log_weight[o], chosen_rows, count, chosen[o], chosen_log_weight[o]
        )
        _weigh(mass[:n], nearest[:n], count, log_total, chosen_log_weight[o])


class GreedySampler:
    """Samples of the pool that minimise its expected minADE: a greedy k-median.

    They are chosen one by one. The first is the weighted medoid, each next one lowers
    the expected distance to the nearest one most. After the first, greedy choices reach
    at least 1 - 1/e of the best possible reduction (Nemhauser, Wolsey, Fisher 1978).
    """

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """Choose ``k`` samples of the pool of each object.

        Returns samples [O, k, T, 2] and log-weights [O, k]. The pool is [O, S, T, 2],
        weighted ``log_weight`` [O, S]. A sample with log-weight -inf does not exist. A
        pool of at most k existing samples is copied, and filled up with ones that do
        not exist. No sample is chosen twice: with fewer distinct samples the rest does
        not exist. The log-weight of a chosen sample is that of all samples that are
        nearest to it, so the pool's total is kept. ``rng`` is not used.
        """
        objects, _, future, _ = pool.shape
        chosen = np.empty((objects, k, 2 * future))
        weight = np.empty((objects, k))
        k_medians(*as_points(pool, log_weight), chosen, weight)
        return chosen.reshape(objects, k, future, 2), weight
