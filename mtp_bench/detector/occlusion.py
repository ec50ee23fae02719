"""How much of each box a sensor sees past the others, in bird's eye view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import bev_corners, wrap_angle
from ..types import Bools, Floats

_TINY = 1e-12
_TURN = 2 * np.pi


def visible_fraction(box: Floats, sensor: Floats) -> NDArray[np.float64]:
    """Share of the angle a box spans in which nothing stands before it, 0 to 1: boxes ``[M, 7]`` -> ``[M]``.

    ``sensor`` is its position x, y. The ends of all boxes cut the circle into at most 2 M sectors. As long as boxes
    do not overlap, which one comes first is the same all over a sector, so that one ray through its middle gives the
    exact answer for small and far boxes too. Where boxes overlap, the first one on that ray has the sector.

    A box that contains the sensor is fully visible and hides nothing.
    """
    middle, half, inside = _angular_intervals(box, sensor)
    share = np.ones(len(box))
    seen = ~inside
    if int(seen.sum()) > 1:
        share[seen] = _first_in_sectors(box[seen], sensor, middle[seen], half[seen])
    return share


def _angular_intervals(box: Floats, sensor: Floats) -> tuple[Floats, Floats, Bools]:
    """Middle and half width of the angle each box spans, radians; and whether it contains the sensor: all ``[M]``."""
    toward = bev_corners(box) - np.asarray(sensor)[:2]
    bearing = np.arctan2(box[:, 1] - sensor[1], box[:, 0] - sensor[0])
    offset = wrap_angle(np.arctan2(toward[..., 1], toward[..., 0]) - bearing[:, None])
    low, high = offset.min(-1), offset.max(-1)
    along, across = _in_box_frame(box, sensor)
    inside = (np.abs(along) <= box[:, 4] / 2) & (np.abs(across) <= box[:, 5] / 2)
    return bearing + (low + high) / 2, (high - low) / 2, inside


def _in_box_frame(box: Floats, sensor: Floats) -> tuple[Floats, Floats]:
    """The sensor's position along and across each box, from its centre, metres: ``[M]`` each."""
    cos, sin = np.cos(box[:, 3]), np.sin(box[:, 3])
    dx, dy = sensor[0] - box[:, 0], sensor[1] - box[:, 1]
    return cos * dx + sin * dy, cos * dy - sin * dx


def _first_in_sectors(box: Floats, sensor: Floats, middle: Floats, half: Floats) -> Floats:
    """Visible share of boxes ``[M, 7]`` none of which contains the sensor -> ``[M]``."""
    ends = np.sort(np.remainder(np.concatenate([middle - half, middle + half]), _TURN))
    width = np.diff(ends, append=ends[0] + _TURN)
    ray = ends + width / 2
    hit = np.abs(wrap_angle(ray[:, None] - middle)) <= half
    distance = np.where(hit, _entry(ray, box, sensor), np.inf)
    first = distance.argmin(1)
    any_hit = hit.any(1)
    angle = np.bincount(first[any_hit], weights=width[any_hit], minlength=len(box))
    return np.minimum(angle / np.maximum(2 * half, _TINY), 1.0)


def _entry(ray: Floats, box: Floats, sensor: Floats) -> Floats:
    """Distance at which rays ``[n]`` (directions, radians) enter boxes ``[M, 7]`` that they hit: ``[n, M]`` metres."""
    turn = ray[:, None] - box[:, 3]
    entry = np.full(turn.shape, -np.inf)
    along, across = _in_box_frame(box, sensor)
    for start, step, size in ((along, np.cos(turn), box[:, 4]), (across, np.sin(turn), box[:, 5])):
        inverse = 1.0 / np.where(np.abs(step) < _TINY, _TINY, step)
        np.maximum(entry, -start * inverse - np.abs(inverse) * (size / 2), out=entry)
    return entry
