"""Reducing a pool of samples to k that stand for it (paper, "Trajectory Sampling")."""

from __future__ import annotations

import numpy as np

from ..types import Floats, Ints


class KMeansSampler:
    """Centres of weighted k-means++ clusters, for all objects of a frame at once (Arthur, Vassilvitskii 2007).

    ``iterations`` of Lloyd's algorithm follow the seeding; 0 returns the seeds, which are samples of the pool.
    """

    def __init__(self, iterations: int = 3) -> None:
        self._iterations = iterations

    def reduce(self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """``k`` centres [O, k, T, 2] and log-weights [O, k] for the pool [O, S, T, 2] weighted ``log_weight`` [O, S].

        A sample with log-weight -inf does not exist. A pool that has at most k samples is returned as it is.
        """
        objects, size, future, _ = pool.shape
        exists = np.isfinite(log_weight)
        order = np.argsort(~exists, axis=1, kind="stable")[:, :k]  # those that exist come first
        centre = np.zeros((objects, k, future, 2))
        weight = np.full((objects, k), -np.inf)
        centre[:, : order.shape[1]] = np.take_along_axis(pool, order[:, :, None, None], axis=1)
        weight[:, : order.shape[1]] = np.take_along_axis(log_weight, order, axis=1)
        crowded = np.flatnonzero(exists.sum(axis=1) > k)
        if len(crowded):
            flat = pool[crowded].reshape(len(crowded), size, future * 2)
            # Relative to the heaviest: an object that only unlikely hypotheses hold must not vanish by underflow.
            mass = np.exp(log_weight[crowded] - log_weight[crowded].max(axis=1, keepdims=True))
            found, held = k_means(flat, mass / mass.sum(axis=1, keepdims=True), k, self._iterations, rng)
            centre[crowded] = found.reshape(len(crowded), k, future, 2)
            with np.errstate(divide="ignore"):
                weight[crowded] = np.log(held)
        return centre, weight


def k_means(points: Floats, weight: Floats, k: int, iterations: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Centres [O, k, d] and their share of the weight [O, k], for points [O, S, d] weighted [O, S], S > k."""
    # Relative to the mean the squares are small, so that the expansion of |x - c|^2 keeps its digits.
    shift = np.matmul(weight[:, None], points)
    points = points - shift
    square = np.einsum("osd,osd->os", points, points)
    centre = _seeds(points, weight, square, k, rng)
    nearest = _nearest(points, centre)
    for _ in range(iterations):
        share, total = _cluster_sums(points, weight, nearest, k)
        moved = total / np.maximum(share, 1e-300)[..., None]
        centre = np.where(share[..., None] > 0, moved, centre)
        again = _nearest(points, centre)
        if np.array_equal(again, nearest):
            break
        nearest = again
    share, _ = _cluster_sums(points, weight, nearest, k)
    return centre + shift, share


def _seeds(points: Floats, weight: Floats, square: Floats, k: int, rng: np.random.Generator) -> Floats:
    """Each next seed is a point drawn in proportion to weight x squared distance from the seeds so far."""
    objects = np.arange(len(points))
    chance = weight
    distance = np.full(square.shape, np.inf)
    centre = np.empty((len(points), k, points.shape[2]))
    for j, uniform in enumerate(rng.random((k, len(points)))):
        total = np.cumsum(chance, axis=1)
        # All points sit on a seed already: draw by weight, the seed repeats.
        empty = total[:, -1] <= 0
        if empty.any():
            total[empty] = np.cumsum(weight[empty], axis=1)
        # Below the total and not equal to any partial sum: a point without a chance is never picked.
        mark = np.minimum(uniform * total[:, -1], np.nextafter(total[:, -1], 0))
        centre[:, j] = points[objects, (total <= mark[:, None]).sum(axis=1)]
        dot = np.matmul(points, centre[:, j, :, None])[..., 0]
        new = square - 2 * dot + np.einsum("od,od->o", centre[:, j], centre[:, j])[:, None]
        distance = np.minimum(distance, np.maximum(new, 0.0))
        chance = weight * distance
    return centre


def _nearest(points: Floats, centre: Floats) -> Ints:
    """Index [O, S] of the nearest centre; |x|^2 is the same for all centres and left out."""
    distance = np.einsum("okd,okd->ok", centre, centre)[:, None] - 2 * np.matmul(points, centre.transpose(0, 2, 1))
    return np.asarray(np.argmin(distance, axis=2))


def _cluster_sums(points: Floats, weight: Floats, nearest: Ints, k: int) -> tuple[Floats, Floats]:
    """Weight [O, k] and weighted sum of points [O, k, d] of each cluster."""
    inside = (nearest[:, None, :] == np.arange(k)[:, None]) * weight[:, None, :]  # [O, k, S]
    return inside.sum(axis=2), np.matmul(inside, points)
