"""Overlap and distance of boxes in bird's eye view (BEV) and in 3D; all functions work on pairs of rows at once.

A box is ``x y z yaw l w h``, metres and radians, its centre at x y z, its length along the heading. Boxes stand
upright: they turn about z only. Everything is computed around the centre of the first box of a pair, so that
coordinates of any size keep their precision.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from .types import Floats, Ints

Measure = Callable[[Floats, Floats], Floats]

# Signs of the corners, counter-clockwise from front left: corner j is the farthest one in the j-th quadrant.
_ALONG = np.array([1.0, -1.0, -1.0, 1.0]) / 2
_ACROSS = np.array([1.0, 1.0, -1.0, -1.0]) / 2
_NEXT, _PREVIOUS = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
_RIGHT_ANGLES = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])  # directions 0, 90, 180, 270 degrees
_HAIR = 1e-8  # share of the smallest side: far above rounding, far below what matters
_TINY = 1e-300


def wrap_angle(angle: ArrayLike) -> Floats:
    """``angle`` in radians, brought into [-pi, pi)."""
    turned: Floats = np.remainder(np.asarray(angle, dtype=np.float64) + np.pi, 2 * np.pi)
    return turned - np.pi


def bev_corners(box: Floats) -> Floats:
    """Corners of boxes ``[..., 7]`` in BEV ``[..., 4, 2]``: front left, rear left, rear right, front right."""
    cos, sin = np.cos(box[..., 3, None]), np.sin(box[..., 3, None])
    along, across = box[..., 4, None] * _ALONG, box[..., 5, None] * _ACROSS
    x = box[..., 0, None] + cos * along - sin * across
    y = box[..., 1, None] + sin * along + cos * across
    return np.stack([x, y], axis=-1)


def transform_boxes(box: Floats, yaw: float, translation: ArrayLike) -> Floats:
    """Boxes ``[..., 7]`` after a rigid motion: a turn by ``yaw`` about the z axis, then ``translation`` (x, y, z)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    shift = np.asarray(translation, dtype=np.float64)
    moved = np.array(box, dtype=np.float64)
    moved[..., 0] = cos * box[..., 0] - sin * box[..., 1] + shift[0]
    moved[..., 1] = sin * box[..., 0] + cos * box[..., 1] + shift[1]
    moved[..., 2] += shift[2]
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
    x, y, cos, sin = _relative_pose(a, b)
    l_a, w_a, l_b, w_b = a[..., 4], a[..., 5], b[..., 4], b[..., 5]
    parallel = np.minimum(np.abs(cos), np.abs(sin)) < 1e-3
    hair = parallel * (_HAIR * np.minimum(np.minimum(l_a, w_a), np.minimum(l_b, w_b)))
    l_in, w_in = np.maximum(l_a - hair, 0.0), np.maximum(w_a - hair, 0.0)
    # Corners of b in the frame of a and the other way round.
    b_x, b_y = _corners_at(x, y, cos, sin, l_b, w_b)
    a_x, a_y = _corners_at(-cos * x - sin * y, sin * x - cos * y, cos, -sin, l_in, w_in)
    share_b, twice_area_b = _edges_inside(b_x, b_y, l_in, w_in)
    share_a, _ = _edges_inside(a_x, a_y, l_b, w_b)
    # Every edge of a spans a triangle of l_a * w_a / 4 with the centre of a, the origin of the integral.
    area = (share_b * twice_area_b).sum(-1) / 2 + share_a.sum(-1) * (l_a * w_a / 4)
    return np.asarray(np.clip(area, 0.0, np.minimum(l_a * w_a, l_b * w_b)))


def bev_hull_area(a: Floats, b: Floats) -> Floats:
    """Area of the convex hull of two boxes in BEV, m2: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``.

    Cauchy's formula ``1/2 int (h^2 - h'^2)`` over all directions, with h the farther of both boxes in a direction:
    continuous in every corner, so collinear and coinciding corners need no special case.
    """
    x, y, cos, sin = _relative_pose(a, b)
    # Within a right angle: a box turned by 90 degrees is a box with length and width exchanged.
    quarters, rest_cos, rest_sin = _quarter_turns(cos, sin)
    odd = quarters % 2 == 1
    l_b, w_b = np.where(odd, b[..., 5], b[..., 4]), np.where(odd, b[..., 4], b[..., 5])
    b_x, b_y = _corners_at(x, y, rest_cos, rest_sin, l_b, w_b)
    a_x, a_y = a[..., 4, None] * _ALONG, a[..., 5, None] * _ACROSS
    # Eight sectors of directions; in each one corner of a and one of b is the farthest of its box.
    e_x, e_y = _RIGHT_ANGLES
    f_x = rest_cos[..., None] * e_x - rest_sin[..., None] * e_y
    f_y = rest_sin[..., None] * e_x + rest_cos[..., None] * e_y
    area = _sector_area(a_x, a_y, b_x[..., _PREVIOUS], b_y[..., _PREVIOUS], e_x, e_y, f_x, f_y)
    area += _sector_area(a_x, a_y, b_x, b_y, f_x, f_y, e_x[_NEXT], e_y[_NEXT])
    return np.asarray(area.sum(-1) / 2)


def iou_bev(a: Floats, b: Floats) -> Floats:
    """Intersection over union in BEV, 0 to 1: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``; 0 if both boxes are empty."""
    common = bev_intersection_area(a, b)
    union = a[..., 4] * a[..., 5] + b[..., 4] * b[..., 5] - common
    return common / np.maximum(union, _TINY)


def iou_3d(a: Floats, b: Floats) -> Floats:
    """Intersection over union of volumes, 0 to 1: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``; 0 if both are empty."""
    common, union = _volumes(a, b)
    return common / np.maximum(union, _TINY)


def giou_3d(a: Floats, b: Floats) -> Floats:
    """Generalised IoU, -1 to 1: rows ``[R, 7]`` and ``[R, 7]`` -> ``[R]``.

    IoU - (C - U) / C, where U is the union and C the convex hull in BEV times the joint height (as in AB3DMOT).
    """
    common, union = _volumes(a, b)
    top = np.maximum(a[..., 2] + a[..., 6] / 2, b[..., 2] + b[..., 6] / 2)
    bottom = np.minimum(a[..., 2] - a[..., 6] / 2, b[..., 2] - b[..., 6] / 2)
    enclosing = np.maximum(bev_hull_area(a, b) * (top - bottom), union)  # rounding may not let the union stand out
    return np.asarray(common / np.maximum(union, _TINY) - (enclosing - union) / np.maximum(enclosing, _TINY))


_BEYOND: dict[Measure, float] = {iou_bev: 0.0, iou_3d: 0.0, giou_3d: -np.inf, center_distance: np.inf}


def pairwise(measure: Measure, a: Floats, b: Floats, reach: float | Floats | None = None) -> Floats:
    """``measure`` of all pairs of boxes ``[n, 7]`` and ``[m, 7]`` -> ``[n, m]``.

    Pairs with centres (BEV) farther apart than ``reach`` (metres; may be ``[n, m]``) are not computed. They get a
    value never better than their own: 0 for an IoU, inf for a distance, -inf for anything else. ``reach=None``
    leaves out only what cannot overlap for an IoU, and nothing for other measures; see also `giou_reach`.
    """
    if measure is center_distance and reach is None:
        return center_distance(a[:, None], b[None])
    if reach is None:
        overlap = measure is iou_bev or measure is iou_3d
        reach = _half_diagonal(a)[:, None] + _half_diagonal(b) if overlap else np.inf
    near = (a[:, 0, None] - b[:, 0]) ** 2 + (a[:, 1, None] - b[:, 1]) ** 2 <= np.square(reach)
    value = np.full(near.shape, _BEYOND.get(measure, -np.inf))
    row, column = np.nonzero(near)
    if len(row):
        value[row, column] = measure(a[row], b[column])
    return value


def giou_reach(a: Floats, b: Floats, gate: float) -> Floats:
    """Centre distances ``[n, m]`` beyond which the GIoU of ``[n, 7]`` and ``[m, 7]`` is below ``gate`` (above -1).

    Boxes d apart have a hull of at least d times the smaller least side, and a GIoU of at most their areas / hull - 1.
    Boxes that overlap are always within reach.
    """
    area = (a[:, 4] * a[:, 5])[:, None] + b[:, 4] * b[:, 5]
    side = np.minimum(np.minimum(a[:, 4], a[:, 5])[:, None], np.minimum(b[:, 4], b[:, 5]))
    bound = area / (np.maximum(side, _TINY) * max(1.0 + gate, 1e-9))
    return np.maximum(bound, _half_diagonal(a)[:, None] + _half_diagonal(b))


def _half_diagonal(box: Floats) -> Floats:
    return np.hypot(box[:, 4], box[:, 5]) / 2


def _volumes(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Volume of the intersection and of the union."""
    top = np.minimum(a[..., 2] + a[..., 6] / 2, b[..., 2] + b[..., 6] / 2)
    bottom = np.maximum(a[..., 2] - a[..., 6] / 2, b[..., 2] - b[..., 6] / 2)
    common = bev_intersection_area(a, b) * np.maximum(top - bottom, 0.0)
    volume_a, volume_b = a[..., 4] * a[..., 5] * a[..., 6], b[..., 4] * b[..., 5] * b[..., 6]
    common = np.minimum(common, np.minimum(volume_a, volume_b))
    return common, volume_a + volume_b - common


def _relative_pose(a: Floats, b: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Centre of b in the frame of a, cosine and sine of the yaw between them."""
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    cos, sin = np.cos(a[..., 3]), np.sin(a[..., 3])
    turn = b[..., 3] - a[..., 3]
    return cos * dx + sin * dy, cos * dy - sin * dx, np.cos(turn), np.sin(turn)


def _corners_at(x: Floats, y: Floats, cos: Floats, sin: Floats, l: Floats, w: Floats) -> tuple[Floats, Floats]:
    """Corners ``[R, 4]`` of boxes at x, y with the given heading."""
    along, across = l[..., None] * _ALONG, w[..., None] * _ACROSS
    cos, sin = cos[..., None], sin[..., None]
    return x[..., None] + cos * along - sin * across, y[..., None] + sin * along + cos * across


def _edges_inside(x: Floats, y: Floats, length: Floats, width: Floats) -> tuple[Floats, Floats]:
    """Share of each edge of the polygons ``[R, 4]`` inside the rectangle around 0, and cross(start, edge)."""
    dx, dy = x[..., _NEXT] - x, y[..., _NEXT] - y
    lower, upper = np.zeros_like(x), np.ones_like(x)
    for start, step, size in ((x, dx, length[..., None] / 2), (y, dy, width[..., None] / 2)):
        with np.errstate(over="ignore"):  # parallel edges: inside for all of their length or for none of it
            inverse = 1.0 / np.where(np.abs(step) < _TINY, _TINY, step)
            enter, leave = (-size - start) * inverse, (size - start) * inverse
        lower = np.maximum(lower, np.minimum(enter, leave))
        upper = np.minimum(upper, np.maximum(enter, leave))
    return np.maximum(upper - lower, 0.0), x * dy - y * dx


def _quarter_turns(cos: Floats, sin: Floats) -> tuple[Ints, Floats, Floats]:
    """Whole right angles in a turn (modulo 4), cosine and sine of the rest in [0, 90) degrees."""
    turn = np.arctan2(sin, cos)
    quarters = np.floor(turn / (np.pi / 2)).astype(np.int64)
    rest = turn - quarters * (np.pi / 2)
    return quarters % 4, np.cos(rest), np.sin(rest)


def _sector_area(
    a_x: Floats, a_y: Floats, b_x: Floats, b_y: Floats, u_x: Floats, u_y: Floats, v_x: Floats, v_y: Floats
) -> Floats:
    """Twice the part of Cauchy's integral from direction u to v, where a and b are the farthest corners of their boxes.

    For a fixed corner p the integral of h^2 - h'^2 is -h h'. In a sector the farther box changes at most once: in
    the direction across the line from a to b.
    """
    d_x, d_y = a_x - b_x, a_y - b_y
    first, last = d_x * u_x + d_y * u_y >= 0, d_x * v_x + d_y * v_y >= 0
    p_x, p_y = np.where(first, a_x, b_x), np.where(first, a_y, b_y)
    q_x, q_y = np.where(last, a_x, b_x), np.where(last, a_y, b_y)
    length = np.maximum(np.hypot(d_x, d_y), _TINY)
    t_x, t_y = -d_y / length, d_x / length

    def moment(x: Floats, y: Floats, e_x: Floats, e_y: Floats) -> Floats:
        return (x * e_x + y * e_y) * (y * e_x - x * e_y)

    change = moment(q_x, q_y, t_x, t_y) - moment(p_x, p_y, t_x, t_y)
    return moment(p_x, p_y, u_x, u_y) - moment(q_x, q_y, v_x, v_y) + change
