"""Pieces of lanes that an object may be on, by its place and its direction."""

from typing import NamedTuple

import numpy as np

from ..core import Floats, Ints
from ..tracking import part

MAX_OFFSET_M = 3.0  # of an object from the middle of its lane
_MAX_TURN_RAD = 0.9  # between an object and its lane
_MAX_BEYOND_M = 0.5  # before the beginning or behind the end of a piece of a lane
# usual distance and angle between an object and its lane
_OFFSET_DEVIATION_M = 1.0
_TURN_DEVIATION_RAD = 0.3
MIN_SEGMENT_M = 1e-6
# columns of a match of an object with a piece
ARC, OFFSET, WEIGHT = range(3)


class Lanes(NamedTuple):
    """Pieces of lanes."""

    point: Floats  # [L, Q, 2]
    point_count: Ints  # [L]
    follow: Ints  # [L, 4] successors, -1: none
    bound: Floats  # [L, 4] lowest x y, highest x y of objects that may be on it
    length: Floats  # [L] m


@part
def _nearest_point(
    line: Floats, x: float, y: float
) -> tuple[float, float, float, float]:
    """Find the point of a line [Q, 2] near x y.

    Returns its arc length, the distance (left positive), the direction there, and how
    far x y is before the beginning or behind the end of the line, along it.
    """
    min_distance = np.inf
    arc = 0.0
    offset = 0.0
    direction = 0.0
    beyond = 0.0
    length = 0.0
    for q in range(len(line) - 1):
        ux = line[q + 1, 0] - line[q, 0]
        uy = line[q + 1, 1] - line[q, 1]
        segment = np.hypot(ux, uy)
        if segment < MIN_SEGMENT_M:
            continue
        dx = x - line[q, 0]
        dy = y - line[q, 1]
        ahead = (dx * ux + dy * uy) / segment
        along = min(max(ahead, 0.0), segment)
        rx = dx - along * ux / segment
        ry = dy - along * uy / segment
        distance = np.hypot(rx, ry)
        if distance < min_distance:
            min_distance = distance
            arc = length + along
            direction = np.arctan2(uy, ux)
            offset = distance if ux * ry - uy * rx >= 0 else -distance
            beyond = 0.0
            if q == 0:
                beyond = max(beyond, -ahead)
            if q == len(line) - 2:
                beyond = max(beyond, ahead - segment)
        length += segment
    return arc, offset, direction, beyond


@part
def _is_outside(x: float, y: float, bound: Floats) -> bool:
    return bool(x < bound[0] or y < bound[1] or x > bound[2] or y > bound[3])


@part
def match_pieces(lanes: Lanes, pose: Floats, row: Ints, match: Floats) -> int:
    """Write the pieces that an object may be on, and count them.

    At most 16 are written: numbers to ``row`` [16]; arc length, distance (left
    positive) and weight to ``match`` [16, 3]. ``pose``: x y heading.
    """
    piece_count = 0
    x = pose[0]
    y = pose[1]
    for i in range(len(lanes.point_count)):
        if lanes.point_count[i] < 2 or _is_outside(x, y, lanes.bound[i]):
            continue
        line = lanes.point[i, : lanes.point_count[i]]
        arc, offset, direction, beyond = _nearest_point(line, x, y)
        turn = abs((direction - pose[2] + np.pi) % (2 * np.pi) - np.pi)
        if abs(offset) > MAX_OFFSET_M or turn > _MAX_TURN_RAD or beyond > _MAX_BEYOND_M:
            continue
        row[piece_count] = i
        match[piece_count, ARC] = arc
        match[piece_count, OFFSET] = offset
        match[piece_count, WEIGHT] = np.exp(
            -0.5
            * ((offset / _OFFSET_DEVIATION_M) ** 2 + (turn / _TURN_DEVIATION_RAD) ** 2)
        )
        piece_count += 1
        if piece_count == len(row):
            break
    return piece_count
