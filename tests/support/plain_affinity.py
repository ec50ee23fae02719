"""Affinities of pairs of boxes as they are defined, by shapely, to compare with the compiled ones."""

from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from mtp_bench.core import Floats, Ints
from mtp_bench.core.geometry import bev_corners, bev_intersection_area, iou_3d
from mtp_bench.tracking.parameters import ClassParameters

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


def gains(
    tracks: Floats, track_class: Ints, detections: Floats, detection_class: Ints,
    parameters: tuple[ClassParameters, ...],
) -> Floats:  # fmt: skip
    """Gain [N, D] of each track box [N, 7] with each detected box [D, 7]; at least 0 where a match is allowed."""
    result = np.full((len(tracks), len(detections)), -np.inf)
    for class_id, rule in enumerate(parameters):
        row, column = np.flatnonzero(track_class == class_id), np.flatnonzero(detection_class == class_id)
        if len(row) and len(column):
            gain = _above_gate(tracks[row], detections[column], rule)
            result[np.ix_(row, column)] = np.where(gain >= 0, gain, -np.inf)
    return result


def _above_gate(tracks: Floats, detections: Floats, rule: ClassParameters) -> Floats:
    """Distance of each pair [n, m] from the gate; negative outside."""
    if rule.affinity == "center_distance":
        distance = np.linalg.norm(tracks[:, None, :3] - detections[None, :, :3], axis=-1)
        return np.asarray(rule.gate - distance)
    if rule.affinity == "iou_3d":
        return pairwise(iou_3d, tracks, detections) - rule.gate
    return pairwise(giou_3d, tracks, detections) - rule.gate
