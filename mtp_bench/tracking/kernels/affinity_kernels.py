"""Gains of all leaves with all detections of their class, as rows of the allowed pairs only.

The areas are those of ``geometry.py``: edges clipped by the other rectangle and Green's theorem for the intersection,
Cauchy's formula for the hull. The scalar code needs no arrays, and computes what depends on one box only once per box.
Detections of a class are sorted by x: a leaf meets only those that are near enough along x.
"""

import math

import numpy as np

from ...core import Floats, Ints
from .compile import kernel, part
from .heap import sorted_numbers

CENTER_DISTANCE, IOU_3D, GIOU_3D = range(3)

_HAIR = 1e-8  # this and the next as in geometry.py
_TINY = 1e-300
_MORE = (
    1.0 + 1e-9
)  # a first limit must not exclude by rounding what the exact test lets in
_X, _Y, _Z, _YAW, _L, _W, _H, _COS, _SIN, _RADIUS, _AREA, _SIDE, _PLACE = range(
    13
)  # columns of a described box
_COLUMNS = 13


@part
def _share(
    x: float, y: float, end_x: float, end_y: float, half_l: float, half_w: float
) -> float:
    """Share of the edge from x, y to end_x, end_y that is inside the rectangle around 0."""
    dx = end_x - x
    dy = end_y - y
    # parallel: inside for all of its length or for none of it
    inverse_x = 1.0 / (_TINY if abs(dx) < _TINY else dx)
    inverse_y = 1.0 / (_TINY if abs(dy) < _TINY else dy)
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
    """Shares of the edges of the box at x, y inside the rectangle around 0: left, rear, right, front."""
    c_l = cos * (l * 0.5)
    s_l = sin * (l * 0.5)
    c_w = cos * (w * 0.5)
    s_w = sin * (w * 0.5)
    x0 = x + c_l - s_w
    y0 = y + s_l + c_w
    x1 = x - c_l - s_w
    y1 = y - s_l + c_w
    x2 = x - c_l + s_w
    y2 = y - s_l - c_w
    x3 = x + c_l + s_w
    y3 = y + s_l - c_w
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
    """Area common to box a, around 0 along the x axis, and box b at x, y; see `geometry.bev_intersection_area`."""
    l_in = l_a
    w_in = w_a
    if min(abs(cos), abs(sin)) < 1e-3:
        side_a = min(l_a, w_a)
        side_b = min(l_b, w_b)
        hair = _HAIR * min(side_a, side_b)
        l_in = max(l_a - hair, 0.0)
        w_in = max(w_a - hair, 0.0)
    left, rear, right, front = _edge_shares(
        x, y, cos, sin, l_b, w_b, l_in * 0.5, w_in * 0.5
    )
    # Twice the triangle over an edge with the centre of a: half an area of b, and what the shift of b adds to it.
    along = cos * x + sin * y
    across = cos * y - sin * x
    area = (left + right + rear + front) * (l_b * w_b * 0.5)
    area += (left - right) * (l_b * across) + (front - rear) * (w_b * along)
    left, rear, right, front = _edge_shares(
        -along, -across, cos, -sin, l_in, w_in, l_b * 0.5, w_b * 0.5
    )
    area = area * 0.5 + (left + rear + right + front) * (l_a * w_a * 0.25)
    smaller = min(l_a * w_a, l_b * w_b)
    return max(0.0, min(area, smaller))


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
    """Twice the hull's area between the directions u and v, a and b the farthest corners; see geometry.py."""
    d_x = a_x - b_x
    d_y = a_y - b_y
    if d_x * u_x + d_y * u_y >= 0.0:
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
    if (d_x * u_x + d_y * u_y >= 0.0) == (d_x * v_x + d_y * v_y >= 0.0):
        return area - _moment(p_x, p_y, v_x, v_y)
    change = _moment(q_x, q_y, -d_y, d_x) - _moment(p_x, p_y, -d_y, d_x)
    return (
        area - _moment(q_x, q_y, v_x, v_y) + change / max(d_x * d_x + d_y * d_y, _TINY)
    )


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
    """Area of the convex hull of box a, around 0 along the x axis, and box b at x, y.

    Cauchy's formula ``1/2 int (h^2 - h'^2)`` over all directions, with h the farther of both boxes in a direction.
    """
    # A box turned by 90 degrees is a box with length and width exchanged: what is left is a turn within [0, 90].
    if (cos > 0.0) != (sin >= 0.0):
        l_b, w_b = w_b, l_b
        cos, sin = abs(sin), abs(cos)
    else:
        cos = abs(cos)
        sin = abs(sin)
    l = l_a * 0.5
    w = w_a * 0.5
    c_l = cos * (l_b * 0.5)
    s_l = sin * (l_b * 0.5)
    c_w = cos * (w_b * 0.5)
    s_w = sin * (w_b * 0.5)
    x0 = x + c_l - s_w
    y0 = y + s_l + c_w
    x1 = x - c_l - s_w
    y1 = y - s_l + c_w
    x2 = x - c_l + s_w
    y2 = y - s_l - c_w
    x3 = x + c_l + s_w
    y3 = y + s_l - c_w
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
def _describe(box: Floats, row: int, kind: int, described: Floats, at: int) -> None:
    """Write the columns of a box; the place of a box with a NaN is NaN, so that no box is near it."""
    total = 0.0
    for k in range(7):
        described[at, k] = box[row, k]
        total += box[row, k]
    if kind in (IOU_3D, GIOU_3D):
        described[at, _COS], described[at, _SIN] = (
            math.cos(box[row, 3]),
            math.sin(box[row, 3]),
        )
        described[at, _RADIUS] = math.sqrt(box[row, 4] ** 2 + box[row, 5] ** 2) * 0.5
        described[at, _AREA] = box[row, 4] * box[row, 5]
        described[at, _SIDE] = min(box[row, 4], box[row, 5])
        if math.isnan(total):
            described[at, _X] = np.nan


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
    """True if an axis of box a or of box b separates them; arguments as for `intersection_area`."""
    cos_ = abs(cos)
    sin_ = abs(sin)
    if (
        2.0 * abs(x) > l_a + l_b * cos_ + w_b * sin_
        or 2.0 * abs(y) > w_a + l_b * sin_ + w_b * cos_
    ):
        return True
    along = abs(cos * x + sin * y)
    across = abs(cos * y - sin * x)
    return (
        2.0 * along > l_b + l_a * cos_ + w_a * sin_
        or 2.0 * across > w_b + l_a * sin_ + w_a * cos_
    )


@part
def _overlap_gain(
    a: Floats, i: int, b: Floats, j: int, square: float, kind: int, gate: float
) -> float:
    """IoU or GIoU of two described boxes minus the gate; ``square``: of their distance in BEV."""
    touch = a[i, _RADIUS] + b[j, _RADIUS]
    l_a = a[i, _L]
    w_a = a[i, _W]
    h_a = a[i, _H]
    l_b = b[j, _L]
    w_b = b[j, _W]
    h_b = b[j, _H]
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
    low_a = a[i, _Z] - h_a * 0.5
    low_b = b[j, _Z] - h_b * 0.5
    common = 0.0
    height = min(top_a, top_b) - max(low_a, low_b)
    volume_a = l_a * w_a * h_a
    volume_b = l_b * w_b * h_b
    if (
        height > 0.0
        and square <= touch * touch
        and not _apart(x, y, cos, sin, l_a, w_a, l_b, w_b)
    ):
        if (
            min(abs(cos), abs(sin)) < 2e-3
        ):  # where edges are nearly parallel the last digits of the turn matter
            turn = b[j, _YAW] - a[i, _YAW]
            cos = math.cos(turn)
            sin = math.sin(turn)
        common = intersection_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * height
        smaller = min(volume_a, volume_b)
        common = min(common, smaller)
    union = volume_a + volume_b - common
    iou = common / max(union, _TINY)
    if kind == IOU_3D:
        return float(iou - gate)
    whole = max(top_a, top_b) - min(low_a, low_b)
    # rounding: the union may not stand out
    hull = max(hull_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * whole, union)
    return float(iou - (hull - union) / max(hull, _TINY) - gate)


@part
def _reach(a: Floats, i: int, most: Floats, kind: int, gate: float) -> float:
    """No box of a class that is farther from box ``i`` in BEV may match it; ``most``: see `_by_class`."""
    if kind == CENTER_DISTANCE:
        return abs(gate) * _MORE
    touch = (a[i, _RADIUS] + most[0]) * _MORE
    side = min(a[i, _SIDE], most[2])
    if kind == IOU_3D:
        return touch if gate > 0.0 else np.inf
    # The largest share of both areas that the hull may have beside the half of them that it has anyway.
    slack = max(1.0 / max(1.0 + gate, 1e-9) - 0.5, 0.0) * _MORE
    return max(touch, (a[i, _AREA] + most[1]) * slack / side) if side > 0.0 else np.inf


@part
def _first_from(b: Floats, first: int, last: int, place: float) -> int:
    """First of the boxes from ``first`` to ``last``, in the order of x, at or beyond ``place``."""
    while first < last:
        middle = (first + last) // 2
        if b[middle, _PLACE] < place:
            first = middle + 1
        else:
            last = middle
    return first


@part
def _gain(a: Floats, i: int, b: Floats, j: int, kind: int, gate: float) -> float:
    """Gain of a pair; negative or NaN if it may not match."""
    square = (a[i, _X] - b[j, _X]) ** 2 + (a[i, _Y] - b[j, _Y]) ** 2
    if kind in (IOU_3D, GIOU_3D):
        return _overlap_gain(a, i, b, j, square, kind, gate)
    square += (a[i, _Z] - b[j, _Z]) ** 2
    return gate - math.sqrt(square)


@part
def _by_class(
    detection: Floats, class_id: Ints, kind: Ints
) -> tuple[Ints, Ints, Floats, Floats]:
    """Start of each class [C + 1], detections by class and x [D], their descriptions in that order, and extremes.

    The extremes [C, 3] are the largest radius and area and the least side of a class.
    """
    classes = len(kind)
    start = np.zeros(len(kind) + 2, np.int64)
    place = np.empty(len(class_id))
    for j in range(len(class_id)):
        place[j] = np.inf if math.isnan(detection[j, 0]) else detection[j, 0]
        if 0 <= class_id[j] < classes:
            start[class_id[j] + 2] += 1
    for c in range(classes):
        start[c + 2] += start[c + 1]
    order = np.empty(start[classes + 1], np.int64)
    described = np.zeros((start[classes + 1], _COLUMNS))
    most = np.zeros((classes, 3))
    most[:, 2] = np.inf
    for j in sorted_numbers(place, len(place)):
        c = class_id[j]
        if 0 <= c < classes:
            at = int(start[c + 1])
            start[c + 1] += 1
            order[at] = j
            _describe(detection, j, int(kind[c]), described, at)
            described[at, _PLACE] = place[j]
            if not math.isnan(described[at, _X]):
                most[c, 0], most[c, 1] = (
                    max(most[c, 0], described[at, _RADIUS]),
                    max(most[c, 1], described[at, _AREA]),
                )
                most[c, 2] = min(most[c, 2], described[at, _SIDE])
    return start[: classes + 1], order, described, most


@kernel(
    "Tuple((i8[::1], i8[::1], f8[::1]))(f8[:, :], i8[::1], f8[:, :], i8[::1], i8[::1], f8[::1])"
)
def sparse_pairs(
    track: Floats,  # [N, 7 or more]
    track_class: Ints,  # [N]
    detection: Floats,  # [D, 7 or more]
    detection_class: Ints,  # [D]
    kind: Ints,  # [C] CENTER_DISTANCE, IOU_3D or GIOU_3D
    gate: Floats,  # [C]
) -> tuple[Ints, Ints, Floats]:
    """Allowed pairs as rows: indptr [N + 1], column [E] ascending in each row, gain [E], none negative."""
    start, order, b, most = _by_class(detection, detection_class, kind)
    n = len(track_class)
    capacity = 0
    a = np.zeros((n, _COLUMNS))
    reach = np.empty(n)
    window = np.zeros((n, 2), np.int64)
    for i in range(n):
        c = track_class[i]
        if 0 <= c < len(kind):
            first = int(start[c])
            last = int(start[c + 1])
            _describe(track, i, int(kind[c]), a, i)
            reach[i] = _reach(a, i, most[c], int(kind[c]), gate[c])
            spare = 1e-12 * (1.0 + abs(track[i, 0]))
            if reach[i] < np.inf:
                first = _first_from(b, first, last, a[i, _X] - reach[i] - spare)
                last = _first_from(b, first, last, a[i, _X] + reach[i] + spare)
            window[i, 0], window[i, 1] = first, last
            capacity += last - first
    indptr = np.zeros(n + 1, np.int64)
    column = np.empty(capacity, np.int64)
    gain = np.empty(capacity)
    e = 0
    for i in range(n):
        for j in range(window[i, 0], window[i, 1]):
            distance2 = (a[i, _X] - b[j, _X]) ** 2 + (a[i, _Y] - b[j, _Y]) ** 2
            near = distance2 <= reach[i] * reach[i]
            c = track_class[i]
            value = _gain(a, i, b, j, int(kind[c]), float(gate[c])) if near else -1.0
            k = e
            if value >= 0.0:
                while k > indptr[i] and column[k - 1] > order[j]:
                    column[k] = column[k - 1]
                    gain[k] = gain[k - 1]
                    k -= 1
                column[k] = order[j]
                gain[k] = value
                e += 1
        indptr[i + 1] = e
    return indptr, column[:e].copy(), gain[:e].copy()
