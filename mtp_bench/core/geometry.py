"""Overlap and distance of boxes in bird's eye view (BEV) and in 3D.

All functions work on pairs of rows at once. A box is ``x y z yaw l w h``, metres and
radians, its centre at x y z, its length along the heading. Boxes stand
upright: they turn about z only. Everything is computed around the centre of the first
box of a pair, so that coordinates of any size keep their precision.
"""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Bools, Floats, Ints

# Signs of the corners, counter-clockwise from front left: corner j is the farthest one
# in the j-th quadrant.
_ALONG = np.array([1.0, -1.0, -1.0, 1.0]) / 2
_ACROSS = np.array([1.0, 1.0, -1.0, -1.0]) / 2
_NEXT_CORNER = np.array([1, 2, 3, 0])
# share of the smallest side: far above rounding, far below what matters
_SHRINK_SHARE = 1e-8
_LEAST_SLOPE = 1e-6  # of an axis of a box along x
_PARALLEL = 1e-3  # sine or cosine of the angle between two boxes
_MIN_DIVISOR = 1e-300


def wrap_angle(angle: ArrayLike) -> Floats:
    """Bring ``angle`` in radians into [-pi, pi)."""
    rotated = np.remainder(np.asarray(angle, dtype=np.float64) + np.pi, 2 * np.pi)
    return rotated - np.pi


def bev_corners(box: Floats) -> Floats:
    """Return the corners ``[..., 4, 2]`` of boxes ``[..., 7]`` in BEV.

    The order is front left, rear left, rear right, front right.
    """
    x, y, _, yaw, length, width = (box[..., column] for column in range(6))
    corners = _corners_at(x, y, np.cos(yaw), np.sin(yaw), length, width)
    return np.stack(corners, axis=-1)


def rotate(vector: Floats, yaw: Floats | float) -> Floats:
    """Turn vectors ``[..., 2 or more]`` about z, counter-clockwise.

    Components after x and y stay.
    """
    rotated = np.array(vector, dtype=np.float64)
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    rotated[..., 0] = cos * vector[..., 0] - sin * vector[..., 1]
    rotated[..., 1] = sin * vector[..., 0] + cos * vector[..., 1]
    return rotated


def unit_vectors(heading: Floats | float) -> Floats:
    """Return unit vectors ``[..., 2]`` along headings ``[...]``, rad."""
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def rotation(heading: Floats) -> Floats:
    """Return rotation matrices [N, 2, 2] of headings [N].

    Their columns are the axes along and across the heading.
    """
    cos = np.cos(heading)
    sin = np.sin(heading)
    first_row = np.stack([cos, -sin], axis=-1)
    second_row = np.stack([sin, cos], axis=-1)
    return np.stack([first_row, second_row], axis=-2)


def even_points(line: Floats, count: int) -> Floats:
    """Return points [count, D] of a polyline [n, D], evenly spaced along it."""
    steps_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    station_m = np.append(0.0, np.cumsum(steps_m))
    even_station = np.linspace(0.0, station_m[-1], count)
    even_axes = [np.interp(even_station, station_m, axis) for axis in line.T]
    return np.stack(even_axes, axis=1)


def transform_boxes(box: Floats, yaw: Floats | float, translation: ArrayLike) -> Floats:
    """Move boxes ``[..., 7]`` rigidly.

    They are rotated by ``yaw`` about the z axis, then moved by ``translation`` (x, y,
    z). One motion for all boxes, or one each: ``yaw`` ``[...]`` and ``translation``
    ``[..., 3]``.
    """
    moved = rotate(box, yaw)
    moved[..., :3] += np.asarray(translation, dtype=np.float64)
    moved[..., 3] = wrap_angle(box[..., 3] + yaw)
    return moved


def center_distance(a: Floats, b: Floats) -> Floats:
    """Return the distance of the centres in BEV, metres ``[R]``.

    Rows ``[R, 7]`` and ``[R, 7]``, or longer boxes.
    """
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])


def bev_intersection_area(a: Floats, b: Floats) -> Floats:
    """Return the area common to two boxes in BEV, m2 ``[R]``.

    Rows ``[R, 7]`` and ``[R, 7]``. Green's theorem over the edges of each box as far as
    they run inside the other one. If the boxes are parallel, ``a`` is made smaller by a
    tiny share where edges are compared: none lies on an edge of ``b`` then, and where
    edges did lie on each other those of ``a`` count if both boxes are on the same side,
    and none if they touch from outside.
    """
    dx = b[..., 0] - a[..., 0]
    dy = b[..., 1] - a[..., 1]
    cos_a = np.cos(a[..., 3])
    sin_a = np.sin(a[..., 3])
    # heading and centre of b in the frame of a
    turn = b[..., 3] - a[..., 3]
    x = cos_a * dx + sin_a * dy
    y = cos_a * dy - sin_a * dx
    cos = np.cos(turn)
    sin = np.sin(turn)
    l_a, w_a, l_b, w_b = (box[..., side] for box in (a, b) for side in (4, 5))
    parallel = np.minimum(np.abs(cos), np.abs(sin)) < _PARALLEL
    min_side = np.minimum(np.minimum(l_a, w_a), np.minimum(l_b, w_b))
    shrink = parallel * (_SHRINK_SHARE * min_side)
    l_in = np.maximum(l_a - shrink, 0.0)
    w_in = np.maximum(w_a - shrink, 0.0)
    # corners of b in the frame of a and the other way round
    b_x, b_y = _corners_at(x, y, cos, sin, l_b, w_b)
    a_x, a_y = _corners_at(-cos * x - sin * y, sin * x - cos * y, cos, -sin, l_in, w_in)
    share_b, twice_area_b = _edges_inside(b_x, b_y, l_in, w_in)
    share_a, _ = _edges_inside(a_x, a_y, l_b, w_b)
    # Every edge of a spans a triangle of l_a * w_a / 4 with the centre of a, the origin
    # of the integral.
    area = (share_b * twice_area_b).sum(-1) / 2 + share_a.sum(-1) * (l_a * w_a / 4)
    return np.asarray(np.clip(area, 0.0, np.minimum(l_a * w_a, l_b * w_b)))


def iou_3d(a: Floats, b: Floats) -> Floats:
    """Return the intersection over union of volumes ``[R]``, 0 to 1.

    Rows ``[R, 7]`` and ``[R, 7]``; 0 if both are empty.
    """
    top = np.minimum(a[..., 2] + a[..., 6] / 2, b[..., 2] + b[..., 6] / 2)
    bottom = np.maximum(a[..., 2] - a[..., 6] / 2, b[..., 2] - b[..., 6] / 2)
    common = bev_intersection_area(a, b) * np.maximum(top - bottom, 0.0)
    volume_a = a[..., 4] * a[..., 5] * a[..., 6]
    volume_b = b[..., 4] * b[..., 5] * b[..., 6]
    common = np.minimum(common, np.minimum(volume_a, volume_b))
    return np.asarray(common / np.maximum(volume_a + volume_b - common, _MIN_DIVISOR))


def _corners_at(
    x: Floats, y: Floats, cos: Floats, sin: Floats, l: Floats, w: Floats
) -> tuple[Floats, Floats]:
    """Return the corners ``[R, 4]`` of boxes at x, y with this heading."""
    along = l[..., None] * _ALONG
    across = w[..., None] * _ACROSS
    cos = cos[..., None]
    sin = sin[..., None]
    corner_x = x[..., None] + cos * along - sin * across
    corner_y = y[..., None] + sin * along + cos * across
    return corner_x, corner_y


def _edges_inside(
    x: Floats, y: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Return the share of each edge inside a box, and cross(start, edge).

    The edges are those of polygons with corners ``x, y`` ``[R, 4]``. The box has its
    centre at the origin, and its length along x.
    """
    dx = x[..., _NEXT_CORNER] - x
    dy = y[..., _NEXT_CORNER] - y
    lower = np.zeros_like(x)
    upper = np.ones_like(x)
    half_length = length[..., None] / 2
    half_width = width[..., None] / 2
    for start, step, size in ((x, dx, half_length), (y, dy, half_width)):
        # parallel edges: inside for all of their length or for none of it
        with np.errstate(over="ignore"):
            inverse = 1.0 / np.where(np.abs(step) < _MIN_DIVISOR, _MIN_DIVISOR, step)
            enter = (-size - start) * inverse
            leave = (size - start) * inverse
        lower = np.maximum(lower, np.minimum(enter, leave))
        upper = np.minimum(upper, np.maximum(enter, leave))
    return np.maximum(upper - lower, 0.0), x * dy - y * dx


def overlapping(box: Floats, unmoved_count: int = 0) -> Ints:
    """Return pairs [n, 2] of rows of boxes [N, 7] that overlap.

    The last ``unmoved_count`` boxes are not compared with each other.
    """
    x = box[:, 0]
    y = box[:, 1]
    reach = np.hypot(box[:, 4], box[:, 5]) / 2
    moving = slice(len(box) - unmoved_count)
    dx = x[moving, None] - x
    dy = y[moving, None] - y
    candidates = dx * dx + dy * dy < (reach[moving, None] + reach) ** 2
    first, second = np.nonzero(candidates)
    pairs = np.stack([first, second], axis=1)[first < second]
    if len(pairs) == 0:
        return pairs
    return pairs[boxes_meet(box[pairs[:, 0]], box[pairs[:, 1]])]


def boxes_meet(a: Floats, b: Floats) -> Bools:
    """Mark pairs [n] of boxes a and b [n, 7] that overlap."""
    # by the axes of a, then, for the pairs that are left, by those of b
    meets = ~_separated(a, b)
    meets[meets] = ~_separated(b[meets], a[meets])
    return meets


def sliding_contact(size: tuple[float, float], box: Floats) -> tuple[Floats, Floats]:
    """Return from and to which x a box that slides along x touches boxes [n, 7].

    Its centre is at y = 0; ``size``: its length and width. All in m. Where it passes a
    box without a touch, the first x is the larger one, or any.
    """
    half_length = size[0] / 2
    half_width = size[1] / 2
    cos = np.cos(box[:, 3])
    sin = np.sin(box[:, 3])
    extent = (box[:, 4] * np.abs(cos) + box[:, 5] * np.abs(sin)) / 2
    low = box[:, 0] - extent - half_length
    high = box[:, 0] + extent + half_length
    # by both axes of a box; one across the way parts the boxes nowhere, or everywhere
    for axis_x, axis_y, side in ((cos, sin, box[:, 4]), (-sin, cos, box[:, 5])):
        along = np.where(np.abs(axis_x) < _LEAST_SLOPE, _LEAST_SLOPE, axis_x)
        middle = box[:, 0] + box[:, 1] * axis_y / along
        extent = (side / 2 + half_width * np.abs(axis_y)) / np.abs(along)
        low = np.maximum(low, middle - extent - half_length)
        high = np.minimum(high, middle + extent + half_length)
    return low, high


def _separated(a: Floats, b: Floats) -> Bools:
    """Mark boxes a [n, 7] that one of their own axes separates from b."""
    cos = np.cos(a[:, 3])
    sin = np.sin(a[:, 3])
    x = b[:, 0] - a[:, 0]
    y = b[:, 1] - a[:, 1]
    turn = b[:, 3] - a[:, 3]
    cos_turn = np.abs(np.cos(turn))
    sin_turn = np.abs(np.sin(turn))
    along = (a[:, 4] + cos_turn * b[:, 4] + sin_turn * b[:, 5]) / 2
    across = (a[:, 5] + sin_turn * b[:, 4] + cos_turn * b[:, 5]) / 2
    return (np.abs(cos * x + sin * y) > along) | (np.abs(cos * y - sin * x) > across)
