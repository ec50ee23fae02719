"""Greedy sampler: k samples of a pool that represent it, by a greedy weighted k-median.

It suits pools of learned modes: few, distinct and weighted. The chosen samples keep the shape of a mode; the mean of a
cluster would be a future that no mode has.
"""

import math

import numpy as np

from ..core import Floats, Ints
from ..tracking import kernel, part
from .pools import as_points, existing, masses, pass_on


@part
def _transpose(points: Floats, rows: Ints, transposed: Floats) -> None:
    """Write the points [S, d] in ``rows`` [n] as [d, n], relative to the first one, in single precision."""
    for axis in range(len(transposed)):
        for i in range(len(rows)):
            transposed[axis, i] = points[rows[i], axis] - points[rows[0], axis]


@part
def _distances(transposed: Floats, distance: Floats) -> None:
    """Write distances [n, n] of futures [2 T, n], summed over the T positions; each pair is computed once."""
    for i in range(len(distance)):
        row = distance[i, i:]  # from 0 on: only then the loop is vectorised
        for j in range(len(row)):
            row[j] = np.float32(0.0)
        for axis in range(0, len(transposed), 2):
            x = transposed[axis, i:]
            y = transposed[axis + 1, i:]
            x_here = x[0]
            y_here = y[0]
            for j in range(len(row)):
                across = x[j] - x_here
                along = y[j] - y_here
                row[j] += math.sqrt(across * across + along * along)
        for j in range(i):
            distance[i, j] = distance[j, i]


@part
def _expected(distance: Floats, mass: Floats, expected: Floats) -> None:
    """Write the mean distance [n] of all samples, by mass, from each one."""
    for c in range(len(expected)):
        expected[c] = 0.0
    for s in range(len(mass)):
        row = distance[s]
        weight = mass[s]
        for c in range(len(expected)):
            expected[c] += weight * row[c]


@part
def _lower(row: Floats, mass: float, before: float, now: float, gain: Floats) -> None:
    """Lower the gains [n] when a sample with these distances [n] from all others gets a nearer chosen one."""
    zero = np.float32(0.0)
    for c in range(len(gain)):
        could = before - row[c]
        can = now - row[c]
        gain[c] -= mass * (
            (could if could > zero else zero) - (can if can > zero else zero)
        )


@part
def _first(distance: Floats, mass: Floats, least: Floats, gain: Floats) -> int:
    """The weighted medoid, the first of equals; distances [n] from it and gains [n] of a second choice are written."""
    _expected(distance, mass, gain)
    medoid = 0
    for c in range(len(gain)):
        medoid = c if gain[c] < gain[medoid] else medoid
    for c in range(len(gain)):
        gain[c] = 0.0
        least[c] = distance[medoid, c]
    for s in range(len(mass)):
        _lower(distance[s], -mass[s], least[s], np.float32(0.0), gain)  # type: ignore[arg-type]  # single precision
    return medoid


@part
def _choose(
    distance: Floats,
    mass: Floats,
    chosen: Ints,
    least: Floats,
    nearest: Ints,
    gain: Floats,
) -> int:
    """Number of samples, each of which lowers the expected distance most, the first of equals.

    ``distance`` [n, n], ``mass`` [n]; ``chosen`` [k]: their places; ``least`` and ``nearest`` [n]: distance and
    number of the nearest chosen one; ``gain`` [n]: by how much each would lower the expected distance.
    """
    best = _first(distance, mass, least, gain)
    for s in range(len(mass)):
        nearest[s] = 0
    for j in range(len(chosen)):
        chosen[j] = best
        for s in range(len(mass)):
            now = distance[best, s]
            if now < least[s]:
                _lower(distance[s], mass[s], least[s], now, gain)
                least[s] = now
                nearest[s] = j
            if (
                now == 0.0
            ):  # itself and its equals, whose gain may differ from 0 by rounding
                gain[s] = -np.inf
        for c in range(len(gain)):
            best = c if gain[c] > gain[best] else best
        if gain[best] <= 0.0:
            return j + 1
    return len(chosen)


@part
def _weigh(
    mass: Floats, nearest: Ints, n: int, log_total: float, log_weight: Floats
) -> None:
    """Write log-weights [k] of the ``n`` chosen samples: the weight of the samples that are nearest to each."""
    for j in range(len(log_weight)):
        log_weight[j] = 0.0
    for s in range(len(mass)):
        log_weight[nearest[s]] += mass[s]
    for j in range(len(log_weight)):
        is_chosen = j < n and log_weight[j] > 0.0
        log_weight[j] = log_total + np.log(log_weight[j]) if is_chosen else -np.inf


@kernel("void(f8[:, :, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, ::1])")
def k_medians(
    pool: Floats, log_weight: Floats, chosen: Floats, chosen_log_weight: Floats
) -> None:
    """Write samples [O, k, d] and log-weights [O, k] chosen from pools [O, S, d] weighted [O, S], d = 2 T.

    A pool of at most k existing samples is copied.
    """
    size = pool.shape[1]
    k = chosen.shape[1]
    rows = np.empty(size, np.int64)
    mass = np.empty(size)
    places = np.empty(k, np.int64)
    least = np.empty(size, np.float32)
    nearest = np.empty(size, np.int64)
    gain = np.empty(size)
    table = np.empty(size * max(size, pool.shape[2]) * 2, np.float32)
    for o in range(len(pool)):
        n = existing(log_weight[o], rows)
        if n <= k:
            pass_on(pool[o], log_weight[o], rows, n, chosen[o], chosen_log_weight[o])
            continue
        log_total = masses(log_weight[o], rows, n, mass)
        transposed = table[: pool.shape[2] * n].reshape(pool.shape[2], n)
        distance = table[pool.shape[2] * n : pool.shape[2] * n + n * n].reshape(n, n)
        _transpose(pool[o], rows[:n], transposed)
        _distances(transposed, distance)
        count = _choose(distance, mass[:n], places, least[:n], nearest[:n], gain[:n])
        for j in range(count):
            places[j] = rows[places[j]]
        pass_on(pool[o], log_weight[o], places, count, chosen[o], chosen_log_weight[o])
        _weigh(mass[:n], nearest[:n], count, log_total, chosen_log_weight[o])


class GreedySampler:
    """Samples of the pool that minimise its expected minADE, chosen one by one: a greedy weighted k-median.

    The first is the weighted medoid, each next one lowers the expected distance to the nearest one most. After the
    first, greedy choices reach at least 1 - 1/e of the best possible reduction (Nemhauser, Wolsey, Fisher 1978).
    """

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """``k`` samples [O, k, T, 2] and log-weights [O, k] of the pool [O, S, T, 2] weighted ``log_weight`` [O, S].

        A sample with log-weight -inf does not exist. A pool of at most k existing samples is copied, and filled up with
        ones that do not exist. No sample is chosen twice: with fewer distinct samples the rest does not exist. The
        log-weight of a chosen sample is that of all samples that are nearest to it, so the pool's total is kept.
        ``rng`` is not used.
        """
        objects, _, future, _ = pool.shape
        chosen = np.empty((objects, k, 2 * future))
        weight = np.empty((objects, k))
        k_medians(*as_points(pool, log_weight), chosen, weight)
        return chosen.reshape(objects, k, future, 2), weight
