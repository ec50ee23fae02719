"""What a sensor can see of the true boxes: distance, bearing, occlusion and truncation of every row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import bev_corners, wrap_angle
from ..types import Bools, Floats, Ints, Truth
from .occlusion import visible_fraction

# An object's occlusion level is the number of these thresholds that its visible fraction (BEV) stays below.
VISIBLE = (0.8, 0.4, 0.05)
NOT_OCCLUDED, PARTLY, LARGELY, HIDDEN = range(4)


@dataclass(frozen=True)
class Sensor:
    """What part of the world a sensor covers: a sector of a circle around its heading."""

    reach: float  # m
    field_of_view: float  # rad, the whole angle; 2 pi or more: all around
    area: tuple[float, float, float, float] | None = None  # m, least and largest x, y of clutter; None: any


@dataclass(frozen=True, eq=False)
class Sight:
    """How the sensor sees every row of a truth."""

    frame: Ints  # [R] index of the row's frame
    distance: Floats  # [R] m, BEV, from the sensor to the centre of the box
    bearing: Floats  # [R] rad in [-pi, pi), relative to the sensor's heading
    occlusion: Ints  # [R] 0 none, 1 partly, 2 largely, 3 hidden
    truncated: Bools  # [R] some corner is outside the field of view


def frame_of_rows(start: Ints) -> Ints:
    """Index of the frame of every row ``[R]``, from the first rows of the frames ``[F + 1]``."""
    return np.repeat(np.arange(len(start) - 1), np.diff(start))


def covered(truth: Truth, ego: Floats, sensor: Sensor) -> Bools:
    """Whether the centre of each box is within reach and field of view ``[R]``; ``ego`` is ``[F, 4]`` x y z yaw."""
    pose = ego[frame_of_rows(truth.start)]
    return within(*polar(truth.box[:, :2], pose), sensor)


def within(distance: Floats, bearing: Floats, sensor: Sensor) -> Bools:
    """Whether places at a distance (m) and bearing (rad, from the heading) are covered; any shape, the same for all."""
    return (distance <= sensor.reach) & (np.abs(bearing) <= sensor.field_of_view / 2)


def sight(truth: Truth, ego: Floats, sensor: Sensor, visible: Floats | None = None) -> Sight:
    """How a sensor at ``ego`` (``[F, 4]`` x y z yaw) sees every box, the ones that it does not cover included.

    All boxes of a frame may hide each other, in BEV: heights do not matter. ``visible``: `visible_fractions` if known.
    """
    frame = frame_of_rows(truth.start)
    pose = ego[frame]
    distance, bearing = polar(truth.box[:, :2], pose)
    _, corner_bearing = polar(bev_corners(truth.box), pose[:, None])
    truncated = np.any(np.abs(corner_bearing) > sensor.field_of_view / 2, axis=-1)
    visible = visible_fractions(truth, ego) if visible is None else visible
    occlusion = np.sum(visible[:, None] < np.array(VISIBLE), axis=-1)
    return Sight(frame, distance, bearing, np.asarray(occlusion), np.asarray(truncated))


def polar(place: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """Distance (m) and bearing (rad, from the heading) of places ``[..., 2]`` seen from poses ``[..., 4]``."""
    dx, dy = place[..., 0] - pose[..., 0], place[..., 1] - pose[..., 1]
    return np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[..., 3])


def visible_fractions(truth: Truth, ego: Floats) -> Floats:
    """Share of every box in line of sight of the sensor, 0 to 1: ``[R]`` for sensor positions ``[F, 2 or more]``."""
    visible = np.ones(len(truth.box))
    for t in range(len(ego)):
        rows = truth.rows(t)
        visible[rows] = visible_fraction(truth.box[rows], ego[t, :2])
    return visible
