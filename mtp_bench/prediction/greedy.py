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
def _write_transposed_offsets(points: Floats, rows: Ints, transposed: Floats) -> None:
    """Write points relative to the first as [d, n], in single precision.

    They are the ``rows`` [n] of ``points`` [S, d].
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
        row = distance[i, i:]  # so that j begins at 0: only then the loop is vectorised
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
    """Write the mean distance [n] of all samples from each sample.

    ``mass`` [n] weights the samples and has the sum 1.
    """
    for c in range(len(mean)):
        mean[c] = 0.0
    for s in range(len(mass)):
        row = distance[s]
        sample_mass = mass[s]
        for c in range(len(mean)):
            mean[c] += sample_mass * row[c]


@part
def _lower_gains(
    row: Floats, mass: float, old_distance: float, new_distance: float, gain: Floats
) -> None:
    """Lower the gains [n] of all candidates after one sample's change.

    The sample is now ``new_distance`` from its nearest chosen sample. A candidate
    gains by as much as it would be nearer. ``row`` [n]: its distances from the sample.
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
    _mean_distances(distance, mass, gain)  # the gains replace them below
    medoid = 0
    for c in range(len(gain)):
        medoid = c if gain[c] < gain[medoid] else medoid
    for c in range(len(gain)):
        gain[c] = 0.0
        min_distance[c] = distance[medoid, c]
    zero: float = np.float32(0.0)  # type: ignore[assignment]  # single precision
    # a negative mass adds, and at the distance 0 no candidate would be nearer
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
    """Choose samples that lower the mean distance most, and count them.

    The mean is over distances to the nearest chosen sample. The first of equals is
    chosen. ``distance`` [n, n], ``mass`` [n]. Written are ``chosen`` [k]: indices;
    ``min_distance`` and ``nearest`` [n]: distance of the nearest chosen sample and its
    place in ``chosen``; ``gain`` [n]: by how much each would lower the mean.
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

    The weight of each is that of all samples nearest to it. ``log_total``: of the pool.
    """
    for j in range(len(log_weight)):
        log_weight[j] = 0.0  # sums of mass first, then their logarithms
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
    """Write samples [O, k, d] chosen from pools [O, S, d].

    Log-weights are [O, S] for pools and [O, k] for ``chosen``, also written; d = 2 T.
    A pool of at most k existing samples is copied.
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
    # of `transposed` [d, n] and `distance` [n, n]
    workspace = np.empty(size * max(size, axes) * 2, np.float32)
    for o in range(len(pool)):
        n = existing(log_weight[o], rows)
        if n <= k:
            pass_on(pool[o], log_weight[o], rows, n, chosen[o], chosen_log_weight[o])
            continue
        log_total = masses(log_weight[o], rows, n, mass)
        transposed = workspace[: axes * n].reshape(axes, n)
        distance = workspace[axes * n : axes * n + n * n].reshape(n, n)
        _write_transposed_offsets(pool[o], rows[:n], transposed)
        _pairwise_distances(transposed, distance)
        count = _choose(
            distance, mass[:n], chosen_rows, min_distance[:n], nearest[:n], gain[:n]
        )
        for j in range(count):
            chosen_rows[j] = rows[chosen_rows[j]]
        pass_on(
            pool[o], log_weight[o], chosen_rows, count, chosen[o], chosen_log_weight[o]
        )
        # in place of the log-weights that were passed on
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
        chosen_log_weight = np.empty((objects, k))
        k_medians(*as_points(pool, log_weight), chosen, chosen_log_weight)
        return chosen.reshape(objects, k, future, 2), chosen_log_weight
