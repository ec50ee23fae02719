"""Visibility of true boxes to a sensor: distance, bearing, truncation and occlusion."""

from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints, Truth, bev_corners, in_groups, wrap_angle

# An object's occlusion level is the number of these thresholds above its visible
# fraction (BEV).
VISIBLE = (0.8, 0.4, 0.05)
PARTLY = 1
LARGELY = 2
HIDDEN = 3
_MIN_DIVISOR = 1e-12
_ANGLE_MARGIN_RAD = 1e-6  # far above rounding
_FULL_TURN = 2 * np.pi
_FRAME_OFFSET = 8.0  # rad between the angles of two frames, more than a turn


@dataclass(frozen=True)
class Sensor:
    """Coverage of a sensor: a sector of a circle around its heading."""

    reach: float  # m
    field_of_view: float  # rad, the whole angle; 2 pi or more: all around
    # m, least and largest x, y of false positives; None: any
    area: tuple[float, float, float, float] | None = None

    def covers(self, distance_m: Floats, bearing_rad: Floats) -> Bools:
        """Return the mask of places within reach and field of view.

        ``distance_m`` (m) and ``bearing_rad`` (rad) have any common shape.
        """
        return (distance_m <= self.reach) & (
            np.abs(bearing_rad) <= self.field_of_view / 2
        )


@dataclass(frozen=True, eq=False)
class Visibility:
    """Visibility of the R rows of a truth."""

    distance: Floats  # [R] m, BEV, from the sensor to the centre of the box
    bearing: Floats  # [R] rad in [-pi, pi), relative to the sensor's heading
    occlusion: Ints  # [R] 0 none, 1 partly, 2 largely, 3 hidden
    truncated: Bools  # [R] some corner is outside the field of view


def covered(truth: Truth, ego: Floats, sensor: Sensor) -> Bools:
    """Mark boxes [R] with their centre in the coverage.

    ``ego`` [F, 4]: x y z yaw.
    """
    return sensor.covers(*polar(truth.box[:, :2], ego[truth.frame_of_rows]))


def visibility_of(
    truth: Truth, ego: Floats, sensor: Sensor, visible: Floats | None = None
) -> Visibility:
    """Return the visibility of all boxes, also outside the coverage.

    ``ego`` [F, 4]: x y z yaw of the sensor. All boxes of a frame can hide each other in
    BEV; heights do not matter. ``visible``: `visible_fractions`, if known.
    """
    pose = ego[truth.frame_of_rows]
    distance_m, bearing_rad = polar(truth.box[:, :2], pose)
    _, corner_bearing = polar(bev_corners(truth.box), pose[:, None])
    truncated = np.any(np.abs(corner_bearing) > sensor.field_of_view / 2, axis=-1)
    if visible is None:
        visible = visible_fractions(truth, ego)
    occlusion = np.sum(visible[:, None] < np.array(VISIBLE), axis=-1)
    return Visibility(distance_m, bearing_rad, occlusion, np.asarray(truncated))


def polar(place: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """Return distance (m) and bearing (rad) of places.

    Places are ``[..., 2]``; bearings are from the heading. They are seen from poses
    ``[..., 4]``.
    """
    dx = place[..., 0] - pose[..., 0]
    dy = place[..., 1] - pose[..., 1]
    return np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[..., 3])


def visible_fractions(truth: Truth, ego: Floats) -> Floats:
    """Return the unoccluded share [R] of each true box's angle.

    ``ego`` [F, 2 or more]: x y of the sensor. The ends of all boxes cut the circle into
    sectors. A ray through the middle of each finds its nearest box, which is exact for
    boxes that do not overlap. A box that contains the sensor is fully visible and hides
    no other box.
    """
    frame = truth.frame_of_rows
    sensor = ego[frame, :2]
    middle_rad, half_rad, is_inside = _angular_intervals(truth.box, sensor)
    # a box alone in its frame is fully visible
    rows = np.flatnonzero(~is_inside)
    rows = rows[np.bincount(frame[rows])[frame[rows]] > 1]
    visible_share = np.ones(len(truth.box))
    if len(rows):
        visible_share[rows] = _first_in_sectors(
            truth.box[rows], frame[rows], sensor[rows], middle_rad[rows], half_rad[rows]
        )
    return visible_share


def _angular_intervals(box: Floats, sensor: Floats) -> tuple[Floats, Floats, Bools]:
    """Return middle and half width [R] of angles, rad.

    Beside them a mask [R] of boxes that contain the sensor.
    """
    to_corner = bev_corners(box) - sensor[:, None]
    bearing_rad = np.arctan2(box[:, 1] - sensor[:, 1], box[:, 0] - sensor[:, 0])
    corner_bearing = np.arctan2(to_corner[..., 1], to_corner[..., 0])
    offset = wrap_angle(corner_bearing - bearing_rad[:, None])
    low = offset.min(-1)
    high = offset.max(-1)
    along, across = _in_box_frame(box, sensor)
    is_inside = (np.abs(along) <= box[:, 4] / 2) & (np.abs(across) <= box[:, 5] / 2)
    return bearing_rad + (low + high) / 2, (high - low) / 2, is_inside


def _in_box_frame(box: Floats, sensor: Floats) -> tuple[Floats, Floats]:
    """Return the sensor's position [R] along and across each box, m."""
    cos = np.cos(box[:, 3])
    sin = np.sin(box[:, 3])
    dx = sensor[:, 0] - box[:, 0]
    dy = sensor[:, 1] - box[:, 1]
    return cos * dx + sin * dy, cos * dy - sin * dx


def _first_in_sectors(
    box: Floats, frame: Ints, sensor: Floats, middle_rad: Floats, half_rad: Floats
) -> Floats:
    """Return the visible share [R] of boxes that do not contain the sensor."""
    end_angles = np.remainder(
        np.concatenate([middle_rad - half_rad, middle_rad + half_rad]), _FULL_TURN
    )
    end_angles = end_angles[np.lexsort((end_angles, np.tile(frame, 2)))]
    # sectors of each box's frame
    first_sector = 2 * np.searchsorted(frame, frame)
    sector_count = 2 * np.bincount(frame)[frame]
    following = np.append(end_angles[1:], 0.0)
    following[first_sector + sector_count - 1] = end_angles[first_sector] + _FULL_TURN
    sector_width = following - end_angles
    ray_angle = end_angles + sector_width / 2

    # rays that can hit a box: those of the sectors from a little before its first end
    # to a little after its second one
    sorted_ends = end_angles + _FRAME_OFFSET * np.repeat(frame, 2)

    def sector_at(angle_rad: Floats) -> Ints:
        key = np.remainder(angle_rad, _FULL_TURN) + _FRAME_OFFSET * frame
        sector_index = np.searchsorted(sorted_ends, key, side="right") - 1
        return np.asarray(sector_index - first_sector)

    begin = sector_at(middle_rad - half_rad - _ANGLE_MARGIN_RAD)
    end = sector_at(middle_rad + half_rad + _ANGLE_MARGIN_RAD)
    ray_counts = np.minimum((end - begin - 1) % sector_count + 2, sector_count)
    ray_box, ray_number = in_groups(ray_counts)
    sector_index = (
        first_sector[ray_box] + (begin[ray_box] + ray_number) % sector_count[ray_box]
    )
    hit_mask = (
        np.abs(wrap_angle(ray_angle[sector_index] - middle_rad[ray_box]))
        <= half_rad[ray_box]
    )
    ray_box = ray_box[hit_mask]
    sector_index = sector_index[hit_mask]

    distance_m = _entry_distance(ray_angle[sector_index], ray_box, box, sensor)
    nearest_m = np.full(len(ray_angle), np.inf)
    np.minimum.at(nearest_m, sector_index, distance_m)
    # among equally near boxes the first one counts, so it is assigned last
    first_hit = np.flatnonzero(distance_m == nearest_m[sector_index])[::-1]
    sector_owner = np.full(len(ray_angle), -1)
    sector_owner[sector_index[first_hit]] = ray_box[first_hit]
    has_owner = sector_owner >= 0
    visible_rad = np.bincount(
        sector_owner[has_owner], weights=sector_width[has_owner], minlength=len(box)
    )
    return np.minimum(visible_rad / np.maximum(2 * half_rad, _MIN_DIVISOR), 1.0)


def _entry_distance(
    ray_angle: Floats, ray_box: Ints, box: Floats, sensor: Floats
) -> Floats:
    """Return the distances [n], m, where rays enter boxes.

    ``ray_angle`` [n]: directions, rad; ``ray_box`` [n]: row of the box of each ray. A
    ray is inside of a box once it has passed the first of each pair of sides.
    """
    turn_rad = ray_angle - box[ray_box, 3]
    entry_m = np.full(len(turn_rad), -np.inf)
    along, across = _in_box_frame(box, sensor)
    for box_offset, ray_axis, side_length in (
        (along, np.cos(turn_rad), box[:, 4]),
        (across, np.sin(turn_rad), box[:, 5]),
    ):
        inverse = 1.0 / np.where(
            np.abs(ray_axis) < _MIN_DIVISOR, _MIN_DIVISOR, ray_axis
        )
        half_depth = np.abs(inverse) * (side_length[ray_box] / 2)
        entry_m = np.maximum(entry_m, -box_offset[ray_box] * inverse - half_depth)
    return entry_m
