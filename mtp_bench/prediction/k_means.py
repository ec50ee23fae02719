"""Reducing a pool of samples to k that stand for it, by weighted k-means (paper, "Trajectory Sampling").

The clusters of one object are found by compiled code: no distance matrix, whatever the number of samples.
"""

from __future__ import annotations

import numpy as np

from ..tracking.kernels.arrays import first_ints, float_table, floats, ints_of
from ..tracking.kernels.compile import kernel
from ..types import Floats, Ints

_JUST_BELOW = 1.0 - 2.0**-53  # times a number: the next one below it, or that number's half unit


@kernel("void(f4[:, ::1], f8[::1], f8[::1], f8[::1])", vectorize=True)
def _distances(turned: Floats, centre: Floats, origin: Floats, distance: Floats) -> None:
    """Squared distances [S] of points [d, S], relative to an origin [d], from a centre [d].

    The long axis is innermost, for vector units; single precision near the points halves the memory.
    """
    for s in range(len(distance)):
        distance[s] = 0.0
    for axis in range(len(turned)):
        here = centre[axis] - origin[axis]
        for s in range(len(distance)):
            off = turned[axis, s] - here
            distance[s] += off * off


@kernel("void(f8[:, ::1], f4[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[::1], f8[::1])", vectorize=True)
def _seed(
    points: Floats, turned: Floats, weight: Floats, uniform: Floats, centre: Floats, distance: Floats, least: Floats
) -> None:
    """Each next centre is a point drawn in proportion to weight x squared distance from the centres so far."""
    for s in range(len(weight)):
        least[s] = np.inf
    for j in range(len(centre)):
        total = 0.0
        for s in range(len(weight)):
            total += weight[s] if j == 0 else weight[s] * least[s]
        empty = total <= 0.0  # all points sit on a centre already: draw by weight, the centre repeats
        if empty:
            total = 0.0
            for s in range(len(weight)):
                total += weight[s]
        # Below the total and not equal to any partial sum: a point without a chance is never picked.
        mark = min(uniform[j] * total, total * _JUST_BELOW)
        partial, chosen = 0.0, len(weight) - 1
        for s in range(len(weight)):
            partial += weight[s] if j == 0 or empty else weight[s] * least[s]
            if partial > mark:
                chosen = s
                break
        for axis in range(points.shape[1]):
            centre[j, axis] = points[chosen, axis]
        _distances(turned, centre[j], points[0], distance)
        for s in range(len(weight)):
            least[s] = min(least[s], distance[s])


@kernel("b1(f8[:, ::1], f4[:, ::1], f8[:, ::1], f8[::1], f8[::1], i8[::1])", vectorize=True)
def _assign(points: Floats, turned: Floats, centre: Floats, distance: Floats, least: Floats, nearest: Ints) -> bool:
    """Give every point to its nearest centre, the first of equally near ones; whether any changed."""
    changed, before = False, first_ints(nearest, len(nearest))
    for s in range(len(distance)):
        least[s] = np.inf
    for j in range(len(centre)):
        _distances(turned, centre[j], points[0], distance)
        for s in range(len(distance)):
            if distance[s] < least[s]:
                least[s] = distance[s]
                nearest[s] = j
    for s in range(len(nearest)):
        changed |= before[s] != nearest[s]
    return changed


@kernel("void(f8[::1], i8[::1], f8[::1])", vectorize=True)
def _shares(weight: Floats, nearest: Ints, share: Floats) -> None:
    """Weight of the points of each centre."""
    for j in range(len(share)):
        share[j] = 0.0
    for s in range(len(weight)):
        share[nearest[s]] += weight[s]


@kernel("void(f8[:, ::1], f8[::1], i8[::1], f8[:, ::1], f8[::1])", vectorize=True)
def _move(points: Floats, weight: Floats, nearest: Ints, centre: Floats, share: Floats) -> None:
    """Move every centre to the mean of its points; one without any stays. ``share``: their weight."""
    _shares(weight, nearest, share)
    for j in range(len(centre)):
        for axis in range(centre.shape[1]):
            centre[j, axis] = 0.0 if share[j] > 0.0 else centre[j, axis]
    for s in range(len(weight)):
        part = weight[s] / share[nearest[s]] if weight[s] > 0.0 else 0.0
        for axis in range(centre.shape[1]):
            centre[nearest[s], axis] += part * points[s, axis]


@kernel("Tuple((f8[:, ::1], f8[::1]))(f8[:, ::1], f8[::1], f8[::1], i8)", vectorize=True)
def k_means(points: Floats, weight: Floats, uniform: Floats, iterations: int) -> tuple[Floats, Floats]:
    """Centres [k, d] and their share of the weight [k] of points [S, d] weighted [S], for uniform numbers [k].

    Seeds of k-means++, then at most ``iterations`` of Lloyd's algorithm (Arthur, Vassilvitskii 2007).
    """
    k, d = len(uniform), points.shape[1]
    turned = np.empty((d, len(points)), dtype=np.float32)
    for s in range(len(points)):
        for axis in range(d):
            turned[axis, s] = points[s, axis] - points[0, axis]
    centre, share = float_table(k, d), floats(k)
    distance, least = floats(len(weight)), floats(len(weight))
    nearest = ints_of(len(weight), -1)
    _seed(points, turned, weight, uniform, centre, distance, least)
    _assign(points, turned, centre, distance, least, nearest)
    for _ in range(iterations):
        _move(points, weight, nearest, centre, share)
        if not _assign(points, turned, centre, distance, least, nearest):
            break
    _shares(weight, nearest, share)
    return centre, share


class KMeansSampler:
    """Centres of weighted k-means++ clusters, for all objects of a frame at once (Arthur, Vassilvitskii 2007).

    ``iterations`` of Lloyd's algorithm follow the seeding; 0 returns the seeds, which are samples of the pool.
    """

    def __init__(self, iterations: int = 3) -> None:
        self._iterations = iterations

    def reduce(self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """``k`` centres [O, k, T, 2] and log-weights [O, k] for the pool [O, S, T, 2] weighted ``log_weight`` [O, S].

        A sample with log-weight -inf does not exist. A pool that has at most k samples is returned as it is. Objects
        may come in one call or in several: the random numbers are drawn object by object.
        """
        objects, _, future, _ = pool.shape
        exists = np.isfinite(log_weight)
        order = np.argsort(~exists, axis=1, kind="stable")[:, :k]  # those that exist come first
        centre = np.zeros((objects, k, future, 2))
        weight = np.full((objects, k), -np.inf)
        centre[:, : order.shape[1]] = np.take_along_axis(pool, order[:, :, None, None], axis=1)
        weight[:, : order.shape[1]] = np.take_along_axis(log_weight, order, axis=1)
        for o in np.flatnonzero(exists.sum(axis=1) > k):
            # Relative to the heaviest: an object that only unlikely hypotheses hold must not vanish by underflow.
            here = log_weight[o, exists[o]]
            mass = np.exp(here - here.max())
            points = (pool[o] if len(here) == pool.shape[1] else pool[o, exists[o]]).reshape(-1, future * 2)
            found, held = k_means(points, mass / mass.sum(), rng.random(k), self._iterations)
            centre[o] = found.reshape(k, future, 2)
            with np.errstate(divide="ignore"):
                weight[o] = np.log(held)
        return centre, weight
