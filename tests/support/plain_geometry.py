"""Measures of pairs of boxes as they are defined, by shapely: what the compiled ones are compared with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from mtp_bench.geometry import bev_corners, bev_intersection_area
from mtp_bench.types import Floats

_TINY = 1e-300

multipoints: Any = shapely.multipoints  # its types know no arrays of points


def bev_hull_area(a: Floats, b: Floats) -> Floats:
    """Area of the convex hull of two boxes in BEV, m2: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``."""
    known = np.isfinite(a + b).all(axis=1)
    offset = np.column_stack([a[known, :2], np.zeros((known.sum(), 5))])  # around a, for the sake of precision
    corners = np.concatenate([bev_corners(a[known] - offset), bev_corners(b[known] - offset)], axis=1)
    area = np.full(len(a), np.nan)
    area[known] = shapely.area(shapely.convex_hull(multipoints(shapely.points(corners))))
    return area


def giou_3d(a: Floats, b: Floats) -> Floats:
    """Generalised IoU, -1 to 1: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``.

    IoU - (C - U) / C, where U is the union and C the convex hull in BEV times the joint height (as in AB3DMOT).
    """
    (low_a, high_a), (low_b, high_b) = ((box[:, 2] - box[:, 6] / 2, box[:, 2] + box[:, 6] / 2) for box in (a, b))
    shared = np.maximum(np.minimum(high_a, high_b) - np.maximum(low_a, low_b), 0.0)
    volume_a, volume_b = a[:, 4:].prod(1), b[:, 4:].prod(1)
    common = np.minimum(bev_intersection_area(a, b) * shared, np.minimum(volume_a, volume_b))
    union = volume_a + volume_b - common
    joint = np.maximum(high_a, high_b) - np.minimum(low_a, low_b)
    enclosing = np.maximum(bev_hull_area(a, b) * joint, union)  # rounding may not let the union stand out
    return np.asarray(common / np.maximum(union, _TINY) - (enclosing - union) / np.maximum(enclosing, _TINY))


def pairwise(measure: Callable[[Floats, Floats], Floats], a: Floats, b: Floats) -> Floats:
    """``measure`` of all pairs of boxes ``[n, 7]`` and ``[m, 7]`` -> ``[n, m]``."""
    return measure(np.repeat(a, len(b), axis=0), np.tile(b, (len(a), 1))).reshape(len(a), len(b))


def giou_reach(a: Floats, b: Floats, gate: float) -> Floats:
    """Centre distances ``[n, m]`` beyond which the GIoU of ``[n, 7]`` and ``[m, 7]`` is below ``gate`` (above -1).

    Boxes d apart have a hull of at least d times the smaller least side, and a GIoU of at most their areas / hull - 1.
    Boxes that overlap are always within reach.
    """
    area = (a[:, 4] * a[:, 5])[:, None] + b[:, 4] * b[:, 5]
    side = np.minimum(np.minimum(a[:, 4], a[:, 5])[:, None], np.minimum(b[:, 4], b[:, 5]))
    bound = area / (np.maximum(side, _TINY) * max(1.0 + gate, 1e-9))
    return np.maximum(bound, (np.hypot(a[:, 4], a[:, 5])[:, None] + np.hypot(b[:, 4], b[:, 5])) / 2)
