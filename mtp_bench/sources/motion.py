"""Velocities from positions, and people of whom only the place is known.

People are boxes of one nominal size.
"""

from dataclasses import replace

import numpy as np

from ..core import (
    Bools,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    pieces_of,
    starts_of_sorted,
)
from .base import detections_by_frame, no_detections, stored_label

# m, length, width, height: nominal, the same for every person
PERSON = 0.6, 0.6, 1.75


def unknown_velocity(rows: int) -> Floats:
    """Return velocities [R, 2] that are not measured: NaN."""
    return np.full((rows, 2), np.nan)


def backward_velocity(
    frame: Ints, object_id: Ints, position: Floats, time: Floats, period: float
) -> Floats:
    """Return velocities [R, 2] m/s since the position in the frame before.

    NaN if the object was absent there, or after a hole in time. ``frame`` and
    ``object_id`` [R], ``position`` [R, 2] m, ``time`` [F] s; ``period``: nominal, s.
    """
    velocity = np.full(position.shape, np.nan)
    row_order = np.lexsort((frame, object_id))
    # a hole in time makes a step larger than 1
    frame_steps = np.diff(frame[row_order]) + np.diff(
        pieces_of(time, period)[frame[row_order]]
    )
    follows = (np.diff(object_id[row_order]) == 0) & (frame_steps == 1)
    first_rows = row_order[:-1][follows]
    second_rows = row_order[1:][follows]
    step_s = time[frame[second_rows]] - time[frame[first_rows]]
    velocity[second_rows] = (position[second_rows] - position[first_rows]) / step_s[
        :, None
    ]
    return velocity


def looking_back(truth: Truth, time: Floats, period: float) -> Truth:
    """Return the truth with backward velocities, which an agent may see.

    ``time`` [F] s; ``period``: nominal, s.
    """
    position = truth.box[:, :2]
    velocity = backward_velocity(
        truth.frame_of_rows, truth.object_id, position, time, period
    )
    return replace(truth, velocity=velocity)


def central_velocity(
    frame: Ints, object_id: Ints, position: Floats, period: float
) -> Floats:
    """Return velocities [R, 2] m/s from the positions one frame before and after.

    NaN without both. They show where the object is in the next frame: a source of such
    velocities has the trait ``velocity_ahead``.
    """
    velocity = np.full(position.shape, np.nan)
    row_order = np.lexsort((frame, object_id))
    first_rows = row_order[:-2]
    last_rows = row_order[2:]
    follows = (object_id[first_rows] == object_id[last_rows]) & (
        frame[last_rows] - frame[first_rows] == 2
    )
    moved_m = position[last_rows[follows]] - position[first_rows[follows]]
    velocity[row_order[1:-1][follows]] = moved_m / (2 * period)
    return velocity


def person_boxes(place: Floats) -> Floats:
    """Return boxes [R, 7] of people at places [R, 2], heading along x."""
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
    """Return the truth of people.

    Velocities are backward differences. ``frame`` [R] sorted, ``place`` [R, 2] m,
    ``person`` [R], ``time`` [F] s, ``neutral`` [R]; ``period``: nominal time between
    two frames, s.
    """
    if neutral is None:
        neutral = np.zeros(len(frame), dtype=bool)
    return Truth(
        start=starts_of_sorted(frame, len(time)),
        box=person_boxes(place),
        velocity=backward_velocity(frame, person, place, time, period),
        class_id=np.zeros(len(frame), dtype=np.int64),
        object_id=person,
        eligible=~neutral,
        neutral=neutral,
    )


def people_detections(
    frame: Ints, place: Floats, score: Floats, frames: int
) -> Detections:
    """Return detections of people without velocities, from R rows in any order.

    ``frame`` [R], ``place`` [R, 2] m, ``score`` [R].
    """
    class_id = np.zeros(len(frame), dtype=np.int64)
    return detections_by_frame(frames, frame, person_boxes(place), class_id, score)


def people_scene(
    name: str,
    recording: str,
    time: Floats,
    reference_point: Floats,
    truth: Truth,
    stored: tuple[Detections, str] | None = None,
) -> Scene:
    """Return a scene of people in full view, without an ego vehicle.

    ``reference_point`` [4] stands for the ego; ``stored``: detections and the name of
    their detector, None if they are to be simulated.
    """
    frames = len(time)
    detections, detector = stored or (no_detections(frames), "")
    return Scene(
        name=name,
        time=time,
        ego=np.tile(reference_point, (frames, 1)),
        truth=truth,
        detections=detections,
        detector=stored_label(detector),
        visible=np.ones(len(truth.box)),
        recording=recording,
    )


def extent(box: Floats) -> tuple[float, float, float, float] | None:
    """Return least x and y, largest x and y of boxes [R, 7], m.

    None without boxes.
    """
    if not len(box):
        return None
    x = box[:, 0]
    y = box[:, 1]
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def middle(place: Floats) -> Floats:
    """Return the centre x y 0 0 of the extent of places.

    ``place`` [R, 2 or more] m. The centre is in whole metres, 0 without places.
    """
    point = np.zeros(4)
    if len(place):
        corner_sum = place[:, :2].min(axis=0) + place[:, :2].max(axis=0)
        point[:2] = np.round(corner_sum / 2) + 0.0  # no negative zero
    return point


def as_places(detections: Detections) -> Detections:
    """Return detections with nominal sizes and headings, so that only places differ.

    Otherwise the simulated size and heading of a false positive would give it away.
    """
    return replace(detections, box=person_boxes(detections.box[:, :2]))
