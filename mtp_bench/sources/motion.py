"""Velocities from positions, and people as boxes of one nominal size, of whom the place on the ground is known."""

from dataclasses import replace

import numpy as np

from ..core import Bools, Detections, Floats, Ints, Truth, pieces_of, starts_of_sorted

PERSON = 0.6, 0.6, 1.75  # m, length, width, height: nominal, the same for every person


def unknown_velocity(rows: int) -> Floats:
    """Velocities ``[R, 2]`` of boxes whose velocity is not measured: NaN."""
    return np.full((rows, 2), np.nan)


def backward_velocity(
    frame: Ints, object_id: Ints, position: Floats, time: Floats, period: float
) -> Floats:
    """Velocities ``[R, 2]`` m/s since the object's position in the frame before; NaN if it was absent, or after a hole.

    ``frame`` and ``object_id`` ``[R]``, ``position`` ``[R, 2]`` m, ``time`` ``[F]`` s; ``period``: nominal, s.
    """
    velocity = np.full(position.shape, np.nan)
    order = np.lexsort((frame, object_id))
    before, now = order[:-1], order[1:]
    step = np.diff(frame[order]) + np.diff(pieces_of(time, period)[frame[order]])
    follows = (object_id[before] == object_id[now]) & (step == 1)
    before, now = before[follows], now[follows]
    velocity[now] = (position[now] - position[before]) / (
        time[frame[now]] - time[frame[before]]
    )[:, None]
    return velocity


def looking_back(truth: Truth, time: Floats, period: float) -> Truth:
    """``truth`` with backward velocities: which an agent may see. ``time`` ``[F]`` s; ``period``: nominal, s."""
    velocity = backward_velocity(
        truth.frame_of_rows, truth.object_id, truth.box[:, :2], time, period
    )
    return replace(truth, velocity=velocity)


def central_velocity(
    frame: Ints, object_id: Ints, position: Floats, period: float
) -> Floats:
    """Velocities ``[R, 2]`` m/s from the object's positions ``[R, 2]`` one frame before and after; NaN without both.

    They show where the object is in the next frame: a source of such velocities has the trait ``velocity_ahead``.
    """
    velocity = np.full(position.shape, np.nan)
    order = np.lexsort((frame, object_id))
    before, here, after = order[:-2], order[1:-1], order[2:]
    follows = (object_id[before] == object_id[after]) & (
        frame[after] - frame[before] == 2
    )
    before, here, after = before[follows], here[follows], after[follows]
    velocity[here] = (position[after] - position[before]) / (2 * period)
    return velocity


def person_boxes(place: Floats) -> Floats:
    """Boxes ``[R, 7]`` of people at places ``[R, 2]``, heading along x."""
    box = np.zeros((len(place), 7))
    box[:, :2] = place
    box[:, 2] = PERSON[2] / 2
    box[:, 4:] = PERSON
    return box


def people_truth(
    frame: Ints,
    place: Floats,
    person: Ints,
    time: Floats,
    period: float,
    neutral: Bools | None = None,
) -> Truth:
    """Truth of people; velocities are backward differences.

    ``frame`` ``[R]`` sorted, ``place`` ``[R, 2]`` m, ``person`` ``[R]``, ``time`` ``[F]`` s, ``neutral`` ``[R]``;
    ``period``: nominal time between two frames, s.
    """
    start, class_id = (
        starts_of_sorted(frame, len(time)),
        np.zeros(len(frame), dtype=np.int64),
    )
    velocity = backward_velocity(frame, person, place, time, period)
    neutral = np.zeros(len(frame), dtype=bool) if neutral is None else neutral
    return Truth(
        start, person_boxes(place), velocity, class_id, person, ~neutral, neutral
    )


def people_detections(
    frame: Ints, place: Floats, score: Floats, frames: int
) -> Detections:
    """Detections of people without velocities: ``frame`` ``[R]`` sorted, ``place`` ``[R, 2]`` m, ``score`` ``[R]``."""
    class_id = np.zeros(len(frame), dtype=np.int64)
    velocity = unknown_velocity(len(frame))
    return Detections(
        starts_of_sorted(frame, frames), person_boxes(place), velocity, class_id, score
    )


def extent(box: Floats) -> tuple[float, float, float, float] | None:
    """Least x and y, largest x and y of boxes ``[R, 7]``, m; None without any."""
    if not len(box):
        return None
    low, high = box[:, :2].min(axis=0), box[:, :2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def middle(place: Floats) -> Floats:
    """State ``x y z yaw`` of a fixed reference point: the middle of places ``[R, 2]`` or more, in whole metres."""
    if not len(place):
        return np.zeros(4)
    x, y = (
        np.round((place[:, :2].min(axis=0) + place[:, :2].max(axis=0)) / 2) + 0.0
    )  # no negative zero
    return np.array([x, y, 0.0, 0.0])


def as_places(detections: Detections) -> Detections:
    """``detections`` as boxes of the nominal person: places are all that such a detector reports.

    A simulated false positive has a heading and a size of its own, which would tell it from a true one.
    """
    return replace(detections, box=person_boxes(detections.box[:, :2]))
