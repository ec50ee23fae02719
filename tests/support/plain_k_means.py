"""Weighted k-means in NumPy for many objects at once, to compare with."""

from __future__ import annotations

import numpy as np

from mtp_bench.types import Floats, Ints


def k_means(points: Floats, weight: Floats, k: int, iterations: int, uniform: Floats) -> tuple[Floats, Floats]:
    """Centres [O, k, d] and their share of the weight [O, k], for points [O, S, d] weighted [O, S], S > k."""
    # Relative to the mean the squares are small, so that the expansion of |x - c|^2 keeps its digits.
    shift = np.matmul(weight[:, None], points)
    points = points - shift
    square = np.einsum("osd,osd->os", points, points)
    centre = _seeds(points, weight, square, k, uniform)
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


def _seeds(points: Floats, weight: Floats, square: Floats, k: int, uniform: Floats) -> Floats:
    """Each next seed is a point drawn in proportion to weight x squared distance from the seeds so far."""
    objects = np.arange(len(points))
    chance = weight
    distance = np.full(square.shape, np.inf)
    centre = np.empty((len(points), k, points.shape[2]))
    for j, number in enumerate(uniform.T):
        total = np.cumsum(chance, axis=1)
        # All points sit on a seed already: draw by weight, the seed repeats.
        empty = total[:, -1] <= 0
        if empty.any():
            total[empty] = np.cumsum(weight[empty], axis=1)
        # Below the total and not equal to any partial sum: a point without a chance is never picked.
        mark = np.minimum(number * total[:, -1], np.nextafter(total[:, -1], 0))
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
