"""Visibility of true boxes to a sensor: distance, bearing, truncation and occlusion."""

from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints, Truth, bev_corners, wrap_angle

# An object's occlusion level is the number of these thresholds above its visible fraction (BEV).
VISIBLE = (0.8, 0.4, 0.05)
PARTLY, LARGELY, HIDDEN = 1, 2, 3
_TINY = 1e-12
_HAIR = 1e-6  # rad, far above rounding
_TURN = 2 * np.pi


@dataclass(frozen=True)
class Sensor:
    """Coverage of a sensor: a sector of a circle around its heading."""

    reach: float  # m
    field_of_view: float  # rad, the whole angle; 2 pi or more: all around
    area: tuple[float, float, float, float] | None = (
        None  # m, least and largest x, y of false positives; None: any
    )

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


def visibility_of(
    truth: Truth, ego: Floats, sensor: Sensor, visible: Floats | None = None
) -> Visibility:
    """Visibility of all boxes, also outside the coverage, to a sensor at ``ego`` (``[F, 4]`` x y z yaw).

    All boxes of a frame can hide each other in BEV; heights do not matter. ``visible``: `visible_fractions`, if known.
    """
    pose = ego[truth.frame_of_rows]
    distance, bearing = polar(truth.box[:, :2], pose)
    _, corner_bearing = polar(bev_corners(truth.box), pose[:, None])
    truncated = np.any(np.abs(corner_bearing) > sensor.field_of_view / 2, axis=-1)
    visible = visible_fractions(truth, ego) if visible is None else visible
    occlusion = np.sum(visible[:, None] < np.array(VISIBLE), axis=-1)
    return Visibility(distance, bearing, occlusion, np.asarray(truncated))


def polar(place: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """Distance (m) and bearing (rad, from the heading) of places ``[..., 2]`` from poses ``[..., 4]``."""
    dx, dy = place[..., 0] - pose[..., 0], place[..., 1] - pose[..., 1]
    return np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[..., 3])


def visible_fractions(truth: Truth, ego: Floats) -> Floats:
    """Unoccluded share ``[R]``, 0 to 1, of the angle that a true box spans; ``ego`` ``[F, 2 or more]`` x y: the sensor.

    The ends of all boxes cut the circle into sectors; a ray through the middle of each finds its nearest box, which is
    exact for boxes that do not overlap. A box that contains the sensor is fully visible and hides no other box.
    """
    box, frame = truth.box, truth.frame_of_rows
    sensor = ego[frame, :2]
    middle, half, inside = _angular_intervals(box, sensor)
    share, outside = np.ones(len(box)), ~inside
    outside[outside] = (
        np.bincount(frame[outside])[frame[outside]] > 1
    )  # one alone is fully visible
    if outside.any():
        share[outside] = _first_in_sectors(
            box[outside],
            frame[outside],
            sensor[outside],
            middle[outside],
            half[outside],
        )
    return share


def _angular_intervals(box: Floats, sensor: Floats) -> tuple[Floats, Floats, Bools]:
    """Middle and half width of the angle of each box, rad, and a mask of boxes that contain the sensor: ``[R]``."""
    to_corner = bev_corners(box) - sensor[:, None]
    bearing = np.arctan2(box[:, 1] - sensor[:, 1], box[:, 0] - sensor[:, 0])
    offset = wrap_angle(
        np.arctan2(to_corner[..., 1], to_corner[..., 0]) - bearing[:, None]
    )
    low, high = offset.min(-1), offset.max(-1)
    along, across = _in_box_frame(box, sensor)
    inside = (np.abs(along) <= box[:, 4] / 2) & (np.abs(across) <= box[:, 5] / 2)
    return bearing + (low + high) / 2, (high - low) / 2, inside


def _in_box_frame(box: Floats, sensor: Floats) -> tuple[Floats, Floats]:
    """Position of the sensor along and across each box, from its centre, metres: ``[R]`` each."""
    cos, sin = np.cos(box[:, 3]), np.sin(box[:, 3])
    dx, dy = sensor[:, 0] - box[:, 0], sensor[:, 1] - box[:, 1]
    return cos * dx + sin * dy, cos * dy - sin * dx


def _first_in_sectors(
    box: Floats, frame: Ints, sensor: Floats, middle: Floats, half: Floats
) -> Floats:
    """Visible share of boxes ``[R, 7]`` that do not contain the sensor: ``[R]``."""
    ends = np.remainder(np.concatenate([middle - half, middle + half]), _TURN)
    ends = ends[np.lexsort((ends, np.tile(frame, 2)))]
    first, count = (
        2 * np.searchsorted(frame, frame),
        2 * np.bincount(frame)[frame],
    )  # sectors of each box's frame
    following = np.append(ends[1:], 0.0)
    following[first + count - 1] = ends[first] + _TURN
    width = following - ends
    ray = ends + width / 2
    # rays that can hit a box: those of the sectors from a little before its first end to a little after its second one
    sorted_ends = ends + 8.0 * np.repeat(frame, 2)
    begin, end = (
        np.searchsorted(
            sorted_ends, np.remainder(angle, _TURN) + 8.0 * frame, side="right"
        )
        - 1
        - first
        for angle in (middle - half - _HAIR, middle + half + _HAIR)
    )
    rays = np.minimum((end - begin - 1) % count + 2, count)
    other = np.repeat(np.arange(len(box)), rays)
    step = np.arange(len(other)) - np.repeat(np.cumsum(rays) - rays, rays)
    sector = first[other] + (begin[other] + step) % count[other]
    hit = np.abs(wrap_angle(ray[sector] - middle[other])) <= half[other]
    other, sector = other[hit], sector[hit]
    distance = _entry_distance(ray[sector], other, box, sensor)
    nearest = np.full(len(ray), np.inf)
    np.minimum.at(nearest, sector, distance)
    seen = np.flatnonzero(distance == nearest[sector])[
        ::-1
    ]  # of equally near boxes the first one
    owner = np.full(len(ray), -1)
    owner[sector[seen]] = other[seen]
    angle = np.bincount(
        owner[owner >= 0], weights=width[owner >= 0], minlength=len(box)
    )
    return np.minimum(angle / np.maximum(2 * half, _TINY), 1.0)


def _entry_distance(ray: Floats, other: Ints, box: Floats, sensor: Floats) -> Floats:
    """Distance at which rays ``[n]`` (directions, rad) enter the boxes ``other`` ``[n]`` that they hit: ``[n]`` m."""
    turn = ray - box[other, 3]
    entry = np.full(len(turn), -np.inf)
    along, across = _in_box_frame(box, sensor)
    for start, step, size in (
        (along, np.cos(turn), box[:, 4]),
        (across, np.sin(turn), box[:, 5]),
    ):
        inverse = 1.0 / np.where(np.abs(step) < _TINY, _TINY, step)
        np.maximum(
            entry,
            -start[other] * inverse - np.abs(inverse) * (size[other] / 2),
            out=entry,
        )
    return entry
