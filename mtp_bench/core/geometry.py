"""Overlap and distance of boxes in bird's eye view (BEV) and in 3D; all functions work on pairs of rows at once.

A box is ``x y z yaw l w h``, metres and radians, its centre at x y z, its length along the heading. Boxes stand
upright: they turn about z only. Everything is computed around the centre of the first box of a pair, so that
coordinates of any size keep their precision.
"""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats

# Signs of the corners, counter-clockwise from front left: corner j is the farthest one in the j-th quadrant.
_ALONG = np.array([1.0, -1.0, -1.0, 1.0]) / 2
_ACROSS = np.array([1.0, 1.0, -1.0, -1.0]) / 2
_NEXT = np.array([1, 2, 3, 0])
_HAIR = 1e-8  # share of the smallest side: far above rounding, far below what matters
_TINY = 1e-300


def wrap_angle(angle: ArrayLike) -> Floats:
    """``angle`` in radians, brought into [-pi, pi)."""
    turned = np.remainder(np.asarray(angle, dtype=np.float64) + np.pi, 2 * np.pi)
    return turned - np.pi


def bev_corners(box: Floats) -> Floats:
    """Corners of boxes ``[..., 7]`` in BEV ``[..., 4, 2]``: front left, rear left, rear right, front right."""
    cos, sin = np.cos(box[..., 3]), np.sin(box[..., 3])
    return np.stack(
        _corners_at(box[..., 0], box[..., 1], cos, sin, box[..., 4], box[..., 5]),
        axis=-1,
    )


def rotate(vector: Floats, yaw: Floats | float) -> Floats:
    """Vectors ``[..., 2 or more]`` turned about z, counter-clockwise; components after x and y stay."""
    turned = np.array(vector, dtype=np.float64)
    c, s = np.cos(yaw), np.sin(yaw)
    turned[..., 0] = c * vector[..., 0] - s * vector[..., 1]
    turned[..., 1] = s * vector[..., 0] + c * vector[..., 1]
    return turned


def unit_vectors(heading: Floats | float) -> Floats:
    """Unit vectors ``[..., 2]`` along headings ``[...]``, rad."""
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def transform_boxes(box: Floats, yaw: Floats | float, translation: ArrayLike) -> Floats:
    """Boxes ``[..., 7]`` after a rigid motion: a turn by ``yaw`` about the z axis, then ``translation`` (x, y, z).

    One motion for all boxes, or one each: ``yaw`` ``[...]`` and ``translation`` ``[..., 3]``.
    """
    moved = rotate(box, yaw)
    moved[..., :3] += np.asarray(translation, dtype=np.float64)
    moved[..., 3] = wrap_angle(box[..., 3] + yaw)
    return moved


def center_distance(a: Floats, b: Floats) -> Floats:
    """Distance of the centres in BEV, metres: rows ``[R, 7]`` and ``[R, 7]`` (or longer boxes) -> ``[R]``."""
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])


def bev_intersection_area(a: Floats, b: Floats) -> Floats:
    """Area common to two boxes in BEV, m2: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``.

    Green's theorem over the edges of each box as far as they run inside the other one. If the boxes are parallel,
    ``a`` is made smaller by a hair where edges are compared: none lies on an edge of ``b`` then, and where edges did
    lie on each other those of ``a`` count if both boxes are on the same side, and none if they touch from outside.
    """
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    cos, sin, turn = np.cos(a[..., 3]), np.sin(a[..., 3]), b[..., 3] - a[..., 3]
    x, y, cos, sin = (
        cos * dx + sin * dy,
        cos * dy - sin * dx,
        np.cos(turn),
        np.sin(turn),
    )  # of b in the frame of a
    l_a, w_a, l_b, w_b = a[..., 4], a[..., 5], b[..., 4], b[..., 5]
    parallel = np.minimum(np.abs(cos), np.abs(sin)) < 1e-3
    hair = parallel * (_HAIR * np.minimum(np.minimum(l_a, w_a), np.minimum(l_b, w_b)))
    l_in, w_in = np.maximum(l_a - hair, 0.0), np.maximum(w_a - hair, 0.0)
    b_x, b_y = _corners_at(
        x, y, cos, sin, l_b, w_b
    )  # corners of b in the frame of a and the other way round
    a_x, a_y = _corners_at(-cos * x - sin * y, sin * x - cos * y, cos, -sin, l_in, w_in)
    share_b, twice_area_b = _edges_inside(b_x, b_y, l_in, w_in)
    share_a, _ = _edges_inside(a_x, a_y, l_b, w_b)
    # Every edge of a spans a triangle of l_a * w_a / 4 with the centre of a, the origin of the integral.
    area = (share_b * twice_area_b).sum(-1) / 2 + share_a.sum(-1) * (l_a * w_a / 4)
    return np.asarray(np.clip(area, 0.0, np.minimum(l_a * w_a, l_b * w_b)))


def iou_3d(a: Floats, b: Floats) -> Floats:
    """Intersection over union of volumes, 0 to 1: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``; 0 if both are empty."""
    top = np.minimum(a[..., 2] + a[..., 6] / 2, b[..., 2] + b[..., 6] / 2)
    bottom = np.maximum(a[..., 2] - a[..., 6] / 2, b[..., 2] - b[..., 6] / 2)
    common = bev_intersection_area(a, b) * np.maximum(top - bottom, 0.0)
    volume_a, volume_b = (
        a[..., 4] * a[..., 5] * a[..., 6],
        b[..., 4] * b[..., 5] * b[..., 6],
    )
    common = np.minimum(common, np.minimum(volume_a, volume_b))
    return np.asarray(common / np.maximum(volume_a + volume_b - common, _TINY))


def _corners_at(
    x: Floats, y: Floats, cos: Floats, sin: Floats, l: Floats, w: Floats
) -> tuple[Floats, Floats]:
    """Corners ``[R, 4]`` of boxes at x, y with the given heading."""
    along, across = l[..., None] * _ALONG, w[..., None] * _ACROSS
    cos, sin = cos[..., None], sin[..., None]
    return x[..., None] + cos * along - sin * across, y[
        ..., None
    ] + sin * along + cos * across


def _edges_inside(
    x: Floats, y: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Share of each edge of the polygons ``[R, 4]`` inside the rectangle around 0, and cross(start, edge)."""
    dx, dy = x[..., _NEXT] - x, y[..., _NEXT] - y
    lower, upper = np.zeros_like(x), np.ones_like(x)
    for start, step, size in (
        (x, dx, length[..., None] / 2),
        (y, dy, width[..., None] / 2),
    ):
        with np.errstate(
            over="ignore"
        ):  # parallel edges: inside for all of their length or for none of it
            inverse = 1.0 / np.where(np.abs(step) < _TINY, _TINY, step)
            enter, leave = (-size - start) * inverse, (size - start) * inverse
        lower = np.maximum(lower, np.minimum(enter, leave))
        upper = np.minimum(upper, np.maximum(enter, leave))
    return np.maximum(upper - lower, 0.0), x * dy - y * dx
