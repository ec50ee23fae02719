"""Gains of leaves with detections of their class, as rows of the allowed pairs.

The areas are those of ``geometry.py``: edges clipped by the other rectangle and Green's
theorem for the intersection, Cauchy's formula for the hull. The scalar code needs no
arrays, and computes what depends on one box only once per box. Detections of a class
are sorted by x: a leaf meets only those that are near enough along x.
"""

import math

import numpy as np

from ...core import Floats, Ints
from .compile import kernel, part
from .heap import sorted_numbers

CENTER_DISTANCE, IOU_3D, GIOU_3D = range(3)

# as in geometry.py: shrinks a box whose edges may lie on those of the other, and the
# least divisor
_SHRINK_SHARE = 1e-8
_MIN_DIVISOR = 1e-300
# a first limit must not exclude by rounding what the exact test lets in
_ROUNDING_FACTOR = 1.0 + 1e-9
# sine or cosine below which edges count as parallel, and below which the last digits of
# the turn matter
_PARALLEL = 1e-3
_NEARLY_PARALLEL = 2e-3
# columns of a described box
_X, _Y, _Z, _YAW, _L, _W, _H, _COS, _SIN, _RADIUS, _AREA, _SIDE, _SORT_X = range(13)
_COLUMNS = 13
# columns of the extremes of a class
_MAX_RADIUS, _MAX_AREA, _MIN_SIDE = range(3)


@part
def _share(
    x: float, y: float, end_x: float, end_y: float, half_l: float, half_w: float
) -> float:
    """Return the share of an edge inside the rectangle around 0.

    The edge goes from x, y to end_x, end_y.
    """
    dx = end_x - x
    dy = end_y - y
    # parallel: inside for all of its length or for none of it
    if abs(dx) < _MIN_DIVISOR:
        dx = _MIN_DIVISOR
    if abs(dy) < _MIN_DIVISOR:
        dy = _MIN_DIVISOR
    inverse_x = 1.0 / dx
    inverse_y = 1.0 / dy
    enter_x = (-half_l - x) * inverse_x
    leave_x = (half_l - x) * inverse_x
    enter_y = (-half_w - y) * inverse_y
    leave_y = (half_w - y) * inverse_y
    lower = max(min(enter_x, leave_x), min(enter_y, leave_y))
    upper = min(max(enter_x, leave_x), max(enter_y, leave_y))
    lower = max(0.0, lower)
    upper = min(1.0, upper)
    return max(upper - lower, 0.0)


@part
def _corners(
    x: float, y: float, cos: float, sin: float, l: float, w: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return the corners x y of a box.

    They come counterclockwise, the left front one first.
    """
    c_l = cos * (l * 0.5)
    s_l = sin * (l * 0.5)
    c_w = cos * (w * 0.5)
    s_w = sin * (w * 0.5)
    return (
        x + c_l - s_w,
        y + s_l + c_w,
        x - c_l - s_w,
        y - s_l + c_w,
        x - c_l + s_w,
        y - s_l - c_w,
        x + c_l + s_w,
        y + s_l - c_w,
    )


@part
def _edge_shares(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l: float,
    w: float,
    half_l: float,
    half_w: float,
) -> tuple[float, float, float, float]:
    """Return the shares of edges inside the rectangle around 0.

    The box is at x, y. Its edges are the left, rear, right and front one.
    """
    x0, y0, x1, y1, x2, y2, x3, y3 = _corners(x, y, cos, sin, l, w)
    return (
        _share(x0, y0, x1, y1, half_l, half_w),
        _share(x1, y1, x2, y2, half_l, half_w),
        _share(x2, y2, x3, y3, half_l, half_w),
        _share(x3, y3, x0, y0, half_l, half_w),
    )


@part
def intersection_area(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> float:
    """Return the area common to two boxes.

    See `geometry.bev_intersection_area`. Box a is around 0 along the x axis, box b at
    x, y.
    """
    l_in = l_a
    w_in = w_a
    if min(abs(cos), abs(sin)) < _PARALLEL:
        side_a = min(l_a, w_a)
        side_b = min(l_b, w_b)
        margin = _SHRINK_SHARE * min(side_a, side_b)
        l_in = max(l_a - margin, 0.0)
        w_in = max(w_a - margin, 0.0)
    # Twice the triangle over an edge with the centre of a: half an area of b, and what
    # the shift of b adds to it.
    l_share, rear, r_share, front = _edge_shares(
        x, y, cos, sin, l_b, w_b, l_in * 0.5, w_in * 0.5
    )
    along = cos * x + sin * y
    across = cos * y - sin * x
    area = (l_share + r_share + rear + front) * (l_b * w_b * 0.5)
    area += (l_share - r_share) * (l_b * across) + (front - rear) * (w_b * along)
    l_share, rear, r_share, front = _edge_shares(
        -along, -across, cos, -sin, l_in, w_in, l_b * 0.5, w_b * 0.5
    )
    area = area * 0.5 + (l_share + rear + r_share + front) * (l_a * w_a * 0.25)
    smaller_area = min(l_a * w_a, l_b * w_b)
    return max(0.0, min(area, smaller_area))


@part
def _moment(x: float, y: float, u_x: float, u_y: float) -> float:
    return (x * u_x + y * u_y) * (y * u_x - x * u_y)


@part
def _sector(
    a_x: float,
    a_y: float,
    b_x: float,
    b_y: float,
    u_x: float,
    u_y: float,
    v_x: float,
    v_y: float,
) -> float:
    """Return twice the hull's area between directions u and v.

    See geometry.py. The farthest corners of the boxes are a and b: p is farther at u, q
    the other one.
    """
    d_x = a_x - b_x
    d_y = a_y - b_y
    a_farther_at_u = d_x * u_x + d_y * u_y >= 0.0
    a_farther_at_v = d_x * v_x + d_y * v_y >= 0.0
    if a_farther_at_u:
        p_x = a_x
        p_y = a_y
        q_x = b_x
        q_y = b_y
    else:
        p_x = b_x
        p_y = b_y
        q_x = a_x
        q_y = a_y
    area = _moment(p_x, p_y, u_x, u_y)
    if a_farther_at_u == a_farther_at_v:
        return area - _moment(p_x, p_y, v_x, v_y)
    change = _moment(q_x, q_y, -d_y, d_x) - _moment(p_x, p_y, -d_y, d_x)
    d_squared = max(d_x * d_x + d_y * d_y, _MIN_DIVISOR)
    return area - _moment(q_x, q_y, v_x, v_y) + change / d_squared


@part
def hull_area(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> float:
    """Return the area of the convex hull of two boxes.

    Box a is around 0 along the x axis, box b at x, y. Cauchy's formula
    ``1/2 int (h^2 - h'^2)`` over all directions, with h the farther of both boxes in a
    direction.
    """
    # A box turned by 90 degrees is a box with length and width exchanged: what is left
    # is a turn within [0, 90].
    abs_cos = abs(cos)
    abs_sin = abs(sin)
    if (cos > 0.0) != (sin >= 0.0):
        cos = abs_sin
        sin = abs_cos
        length_b = l_b
        l_b = w_b
        w_b = length_b
    else:
        cos = abs_cos
        sin = abs_sin
    l = l_a * 0.5
    w = w_a * 0.5
    x0, y0, x1, y1, x2, y2, x3, y3 = _corners(x, y, cos, sin, l_b, w_b)
    area = _sector(l, w, x3, y3, 1.0, 0.0, cos, sin) + _sector(
        l, w, x0, y0, cos, sin, 0.0, 1.0
    )
    area += _sector(-l, w, x0, y0, 0.0, 1.0, -sin, cos) + _sector(
        -l, w, x1, y1, -sin, cos, -1.0, 0.0
    )
    area += _sector(-l, -w, x1, y1, -1.0, 0.0, -cos, -sin) + _sector(
        -l, -w, x2, y2, -cos, -sin, 0.0, -1.0
    )
    area += _sector(l, -w, x2, y2, 0.0, -1.0, sin, -cos) + _sector(
        l, -w, x3, y3, sin, -cos, 1.0, 0.0
    )
    return area * 0.5


@part
def _describe(box: Floats, row: int, kind: int, described: Floats, i: int) -> None:
    """Write a box as row ``i`` of the described ones.

    The x of a box with a NaN is NaN, so that no box is near it.
    """
    total = 0.0
    for k in range(7):
        described[i, k] = box[row, k]
        total += box[row, k]
    if kind in (IOU_3D, GIOU_3D):
        described[i, _COS] = math.cos(box[row, 3])
        described[i, _SIN] = math.sin(box[row, 3])
        described[i, _RADIUS] = math.sqrt(box[row, 4] ** 2 + box[row, 5] ** 2) * 0.5
        described[i, _AREA] = box[row, 4] * box[row, 5]
        described[i, _SIDE] = min(box[row, 4], box[row, 5])
        if math.isnan(total):
            described[i, _X] = np.nan


@part
def _apart(
    x: float,
    y: float,
    cos: float,
    sin: float,
    l_a: float,
    w_a: float,
    l_b: float,
    w_b: float,
) -> bool:
    """Return whether an axis of either box separates them.

    Arguments are those of `intersection_area`.
    """
    abs_cos = abs(cos)
    abs_sin = abs(sin)
    if (
        2.0 * abs(x) > l_a + l_b * abs_cos + w_b * abs_sin
        or 2.0 * abs(y) > w_a + l_b * abs_sin + w_b * abs_cos
    ):
        return True
    along = abs(cos * x + sin * y)
    across = abs(cos * y - sin * x)
    return (
        2.0 * along > l_b + l_a * abs_cos + w_a * abs_sin
        or 2.0 * across > w_b + l_a * abs_sin + w_a * abs_cos
    )


@part
def _overlap_gain(
    a: Floats, i: int, b: Floats, j: int, distance2: float, kind: int, gate: float
) -> float:
    """Return IoU or GIoU of two described boxes, less the gate.

    ``distance2``: their squared distance in BEV.
    """
    touch_distance = a[i, _RADIUS] + b[j, _RADIUS]
    l_a = a[i, _L]
    w_a = a[i, _W]
    h_a = a[i, _H]
    l_b = b[j, _L]
    w_b = b[j, _W]
    h_b = b[j, _H]
    # box b as seen from box a
    cos_a = a[i, _COS]
    sin_a = a[i, _SIN]
    cos_b = b[j, _COS]
    sin_b = b[j, _SIN]
    dx = b[j, _X] - a[i, _X]
    dy = b[j, _Y] - a[i, _Y]
    x = cos_a * dx + sin_a * dy
    y = cos_a * dy - sin_a * dx
    cos = cos_a * cos_b + sin_a * sin_b
    sin = cos_a * sin_b - sin_a * cos_b
    top_a = a[i, _Z] + h_a * 0.5
    top_b = b[j, _Z] + h_b * 0.5
    bottom_a = a[i, _Z] - h_a * 0.5
    bottom_b = b[j, _Z] - h_b * 0.5
    height = min(top_a, top_b) - max(bottom_a, bottom_b)
    volume_a = l_a * w_a * h_a
    volume_b = l_b * w_b * h_b
    intersection = 0.0
    if (
        height > 0.0
        and distance2 <= touch_distance * touch_distance
        and not _apart(x, y, cos, sin, l_a, w_a, l_b, w_b)
    ):
        if min(abs(cos), abs(sin)) < _NEARLY_PARALLEL:
            yaw = b[j, _YAW] - a[i, _YAW]
            cos = math.cos(yaw)
            sin = math.sin(yaw)
        intersection = intersection_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * height
        smaller_volume = min(volume_a, volume_b)
        intersection = min(intersection, smaller_volume)
    union = volume_a + volume_b - intersection
    iou = intersection / max(union, _MIN_DIVISOR)
    if kind == IOU_3D:
        return float(iou - gate)
    total_height = max(top_a, top_b) - min(bottom_a, bottom_b)
    # rounding: the union may not stand out
    hull = max(hull_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * total_height, union)
    return float(iou - (hull - union) / max(hull, _MIN_DIVISOR) - gate)


@part
def _reach(a: Floats, i: int, extremes: Floats, kind: int, gate: float) -> float:
    """Return the BEV distance beyond which no box matches.

    ``extremes`` [3]: of the class of box ``i``, see `_by_class`.
    """
    if kind == CENTER_DISTANCE:
        return abs(gate) * _ROUNDING_FACTOR
    touch_distance = (a[i, _RADIUS] + extremes[_MAX_RADIUS]) * _ROUNDING_FACTOR
    min_side = min(a[i, _SIDE], extremes[_MIN_SIDE])
    if kind == IOU_3D:
        return touch_distance if gate > 0.0 else np.inf
    if not min_side > 0.0:
        return np.inf
    # The largest share of both areas that the hull may have beside the half of them
    # that it has anyway.
    slack = max(1.0 / max(1.0 + gate, 1e-9) - 0.5, 0.0) * _ROUNDING_FACTOR
    hull_reach = (a[i, _AREA] + extremes[_MAX_AREA]) * slack / min_side
    return float(max(touch_distance, hull_reach))


@part
def _first_from(b: Floats, start: int, end: int, x: float) -> int:
    """Return the first of sorted boxes at or beyond ``x``."""
    while start < end:
        middle = (start + end) // 2
        if b[middle, _SORT_X] < x:
            start = middle + 1
        else:
            end = middle
    return start


@part
def _gain(a: Floats, i: int, b: Floats, j: int, kind: int, gate: float) -> float:
    """Return the gain of a pair, negative or NaN if forbidden."""
    distance2 = (a[i, _X] - b[j, _X]) ** 2 + (a[i, _Y] - b[j, _Y]) ** 2
    if kind in (IOU_3D, GIOU_3D):
        return _overlap_gain(a, i, b, j, distance2, kind, gate)
    distance2 += (a[i, _Z] - b[j, _Z]) ** 2
    return float(gate - math.sqrt(distance2))


@part
def _by_class(
    detection: Floats, class_id: Ints, kind: Ints
) -> tuple[Ints, Ints, Floats, Floats]:
    """Sort the detections by class and x, and describe them.

    Returns the start of each class [C + 1], the order [D], the descriptions in that
    order, and the extremes [C, 3]: the largest radius and area and the least side of a
    class.
    """
    classes = len(kind)
    start = np.zeros(classes + 2, np.int64)
    sort_x = np.empty(len(class_id))
    for j in range(len(class_id)):
        sort_x[j] = np.inf if math.isnan(detection[j, 0]) else detection[j, 0]
        if 0 <= class_id[j] < classes:
            start[class_id[j] + 2] += 1
    for c in range(classes):
        start[c + 2] += start[c + 1]
    order = np.empty(start[classes + 1], np.int64)
    described = np.zeros((start[classes + 1], _COLUMNS))
    extremes = np.zeros((classes, 3))
    extremes[:, _MIN_SIDE] = np.inf
    for j in sorted_numbers(sort_x, len(sort_x)):
        c = class_id[j]
        if 0 <= c < classes:
            i = int(start[c + 1])
            start[c + 1] += 1
            order[i] = j
            _describe(detection, j, int(kind[c]), described, i)
            described[i, _SORT_X] = sort_x[j]
            if not math.isnan(described[i, _X]):
                _widen(extremes[c], described[i])
    return start[: classes + 1], order, described, extremes


@part
def _widen(extremes: Floats, described: Floats) -> None:
    """Widen the extremes [3] of a class by a box."""
    extremes[_MAX_RADIUS] = max(extremes[_MAX_RADIUS], described[_RADIUS])
    extremes[_MAX_AREA] = max(extremes[_MAX_AREA], described[_AREA])
    extremes[_MIN_SIDE] = min(extremes[_MIN_SIDE], described[_SIDE])


@kernel(
    "Tuple((i8[::1], i8[::1], f8[::1]))"
    "(f8[:, :], i8[::1], f8[:, :], i8[::1], i8[::1], f8[::1])"
)
def sparse_pairs(
    track: Floats,  # [N, 7 or more]
    track_class: Ints,  # [N]
    detection: Floats,  # [D, 7 or more]
    detection_class: Ints,  # [D]
    kind: Ints,  # [C] CENTER_DISTANCE, IOU_3D or GIOU_3D
    gate: Floats,  # [C]
) -> tuple[Ints, Ints, Floats]:
    """Find the allowed pairs, as compressed sparse rows.

    Returns indptr [N + 1], column [E] and gain [E]. Columns ascend in each row, no gain
    is negative.
    """
    class_start, order, b, extremes = _by_class(detection, detection_class, kind)
    n = len(track_class)
    capacity = 0
    a = np.zeros((n, _COLUMNS))
    reach = np.empty(n)
    window = np.zeros((n, 2), np.int64)
    for i in range(n):
        c = track_class[i]
        if 0 <= c < len(kind):
            start = int(class_start[c])
            end = int(class_start[c + 1])
            _describe(track, i, int(kind[c]), a, i)
            reach[i] = _reach(a, i, extremes[c], int(kind[c]), gate[c])
            margin = 1e-12 * (1.0 + abs(track[i, 0]))
            if reach[i] < np.inf:
                start = _first_from(b, start, end, a[i, _X] - reach[i] - margin)
                end = _first_from(b, start, end, a[i, _X] + reach[i] + margin)
            window[i, 0] = start
            window[i, 1] = end
            capacity += end - start
    indptr = np.zeros(n + 1, np.int64)
    column = np.empty(capacity, np.int64)
    gain = np.empty(capacity)
    e = 0
    for i in range(n):
        c = track_class[i]
        for j in range(window[i, 0], window[i, 1]):
            distance2 = (a[i, _X] - b[j, _X]) ** 2 + (a[i, _Y] - b[j, _Y]) ** 2
            if not distance2 <= reach[i] * reach[i]:  # also NaN
                continue
            pair_gain = _gain(a, i, b, j, int(kind[c]), float(gate[c]))
            if pair_gain >= 0.0:
                k = e
                while k > indptr[i] and column[k - 1] > order[j]:
                    column[k] = column[k - 1]
                    gain[k] = gain[k - 1]
                    k -= 1
                column[k] = order[j]
                gain[k] = pair_gain
                e += 1
        indptr[i + 1] = e
    return indptr, column[:e].copy(), gain[:e].copy()
