"""Gains of leaves with detections of their class, as rows of the allowed pairs.

What depends on one box is computed only once per box. Detections of a class are sorted
by x: a leaf meets only those that are near enough along x.
"""

import math

import numpy as np

from ...core import Floats, Ints
from .box_areas import MIN_DIVISOR, are_apart, hull_area, intersection_area
from .compile import kernel, part
from .heap import sorted_numbers

CENTER_DISTANCE, IOU_3D, GIOU_3D = range(3)

# a first limit must not exclude by rounding what the exact test lets in
_ROUNDING_FACTOR = 1.0 + 1e-9
# sine or cosine below which the last digits of the turn matter
_NEARLY_PARALLEL = 2e-3
# columns of a described box
_X, _Y, _Z, _YAW, _L, _W, _H, _COS, _SIN, _RADIUS, _AREA, _SIDE, _SORT_X = range(13)
_COLUMNS = 13
# columns of the extremes of a class
_MAX_RADIUS, _MAX_AREA, _MIN_SIDE = range(3)


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
        and not are_apart(x, y, cos, sin, l_a, w_a, l_b, w_b)
    ):
        if min(abs(cos), abs(sin)) < _NEARLY_PARALLEL:
            yaw = b[j, _YAW] - a[i, _YAW]
            cos = math.cos(yaw)
            sin = math.sin(yaw)
        intersection = intersection_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * height
        smaller_volume = min(volume_a, volume_b)
        intersection = min(intersection, smaller_volume)
    union = volume_a + volume_b - intersection
    iou = intersection / max(union, MIN_DIVISOR)
    if kind == IOU_3D:
        return float(iou - gate)
    total_height = max(top_a, top_b) - min(bottom_a, bottom_b)
    # rounding: the union may not stand out
    hull = max(hull_area(x, y, cos, sin, l_a, w_a, l_b, w_b) * total_height, union)
    return float(iou - (hull - union) / max(hull, MIN_DIVISOR) - gate)


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
