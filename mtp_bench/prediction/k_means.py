"""Weighted k-means of the samples of one object, compiled: no distance matrix, whatever the number of samples."""

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
