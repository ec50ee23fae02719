"""Visibility of true boxes to a sensor: distance, bearing, truncation and occlusion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import bev_corners, wrap_angle
from ..types import Bools, Floats, Ints, Truth

# An object's occlusion level is the number of these thresholds above its visible fraction (BEV).
VISIBLE = (0.8, 0.4, 0.05)
PARTLY, LARGELY, HIDDEN = 1, 2, 3
_TINY = 1e-12
_TURN = 2 * np.pi


@dataclass(frozen=True)
class Sensor:
    """Coverage of a sensor: a sector of a circle around its heading."""

    reach: float  # m
    field_of_view: float  # rad, the whole angle; 2 pi or more: all around
    area: tuple[float, float, float, float] | None = None  # m, least and largest x, y of false positives; None: any

    def covers(self, distance: Floats, bearing: Floats) -> Bools:
        """Mask of places within reach and field of view, by distance (m) and bearing (rad) of any common shape."""
        return (distance <= self.reach) & (np.abs(bearing) <= self.field_of_view / 2)


@dataclass(frozen=True, eq=False)
class Visibility:
    """Visibility of the R rows of a truth."""

    distance: Floats  # [R] m, BEV, from the sensor to the centre of the box
    bearing: Floats  # [R] rad in [-pi, pi), relative to the sensor's heading
    occlusion: Ints  # [R] 0 none, 1 partly, 2 largely, 3 hidden
    truncated: Bools  # [R] some corner is outside the field of view


def covered(truth: Truth, ego: Floats, sensor: Sensor) -> Bools:
    """Mask of boxes with their centre within reach and field of view ``[R]``; ``ego`` is ``[F, 4]`` x y z yaw."""
    return sensor.covers(*polar(truth.box[:, :2], ego[truth.frame_of_rows]))


def visibility_of(truth: Truth, ego: Floats, sensor: Sensor, visible: Floats | None = None) -> Visibility:
    """Visibility of all boxes, also outside the coverage, to a sensor at ``ego`` (``[F, 4]`` x y z yaw).

    All boxes of a frame can hide each other in BEV; heights do not matter. ``visible``: `visible_fractions`, if known.
    """
    pose = ego[truth.frame_of_rows]
    distance, bearing = polar(truth.box[:, :2], pose)
    _, corner_bearing = polar(bev_corners(truth.box), pose[:, None])
    truncated = np.any(np.abs(corner_bearing) > sensor.field_of_view / 2, axis=-1)
    visible = visible_fractions(truth, ego) if visible is None else visible
    occlusion = np.sum(visible[:, None] < np.array(VISIBLE), axis=-1)
    return Visibility(distance, bearing, np.asarray(occlusion), np.asarray(truncated))


def polar(place: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """Distance (m) and bearing (rad, from the heading) of places ``[..., 2]`` from poses ``[..., 4]``."""
    dx, dy = place[..., 0] - pose[..., 0], place[..., 1] - pose[..., 1]
    return np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[..., 3])


def visible_fractions(truth: Truth, ego: Floats) -> Floats:
    """Unoccluded share ``[R]`` of each true box, 0 to 1; ``ego`` ``[F, 2 or more]`` x y: the sensor in each frame."""
    visible = np.ones(len(truth.box))
    for t in range(len(ego)):
        rows = truth.rows(t)
        visible[rows] = visible_fraction(truth.box[rows], ego[t, :2])
    return visible


def visible_fraction(box: Floats, sensor: Floats) -> NDArray[np.float64]:
    """Unoccluded share of the angle that a box spans, 0 to 1: boxes ``[M, 7]`` -> ``[M]``, from a position x, y.

    The ends of all boxes cut the circle into sectors; a ray through the middle of each finds its nearest box, which is
    exact for boxes that do not overlap. A box that contains the sensor is fully visible and hides no other box.
    """
    middle, half, inside = _angular_intervals(box, sensor)
    share = np.ones(len(box))
    outside = ~inside
    if int(outside.sum()) > 1:
        share[outside] = _first_in_sectors(box[outside], sensor, middle[outside], half[outside])
    return share


def _angular_intervals(box: Floats, sensor: Floats) -> tuple[Floats, Floats, Bools]:
    """Middle and half width of the angle of each box, rad, and a mask of boxes that contain the sensor: ``[M]``."""
    to_corner = bev_corners(box) - np.asarray(sensor)[:2]
    bearing = np.arctan2(box[:, 1] - sensor[1], box[:, 0] - sensor[0])
    offset = wrap_angle(np.arctan2(to_corner[..., 1], to_corner[..., 0]) - bearing[:, None])
    low, high = offset.min(-1), offset.max(-1)
    along, across = _in_box_frame(box, sensor)
    inside = (np.abs(along) <= box[:, 4] / 2) & (np.abs(across) <= box[:, 5] / 2)
    return bearing + (low + high) / 2, (high - low) / 2, inside


def _in_box_frame(box: Floats, sensor: Floats) -> tuple[Floats, Floats]:
    """Position of the sensor along and across each box, from its centre, metres: ``[M]`` each."""
    cos, sin = np.cos(box[:, 3]), np.sin(box[:, 3])
    dx, dy = sensor[0] - box[:, 0], sensor[1] - box[:, 1]
    return cos * dx + sin * dy, cos * dy - sin * dx


def _first_in_sectors(box: Floats, sensor: Floats, middle: Floats, half: Floats) -> Floats:
    """Visible share of boxes ``[M, 7]`` that do not contain the sensor: ``[M]``."""
    ends = np.sort(np.remainder(np.concatenate([middle - half, middle + half]), _TURN))
    width = np.diff(ends, append=ends[0] + _TURN)
    ray = ends + width / 2
    hit = np.abs(wrap_angle(ray[:, None] - middle)) <= half
    distance = np.where(hit, _entry_distance(ray, box, sensor), np.inf)
    first = distance.argmin(1)
    any_hit = hit.any(1)
    angle = np.bincount(first[any_hit], weights=width[any_hit], minlength=len(box))
    return np.minimum(angle / np.maximum(2 * half, _TINY), 1.0)


def _entry_distance(ray: Floats, box: Floats, sensor: Floats) -> Floats:
    """Distance at which rays ``[n]`` (directions, rad) enter boxes ``[M, 7]`` that they hit: ``[n, M]`` metres."""
    turn = ray[:, None] - box[:, 3]
    entry = np.full(turn.shape, -np.inf)
    along, across = _in_box_frame(box, sensor)
    for start, step, size in ((along, np.cos(turn), box[:, 4]), (across, np.sin(turn), box[:, 5])):
        inverse = 1.0 / np.where(np.abs(step) < _TINY, _TINY, step)
        np.maximum(entry, -start * inverse - np.abs(inverse) * (size / 2), out=entry)
    return entry
