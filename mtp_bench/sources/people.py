"""People as boxes of one nominal size: only their places on the ground are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..types import Bools, Detections, Floats, Ints, Truth, starts_of_sorted
from .motion import backward_velocity

PERSON = 0.6, 0.6, 1.75  # m, length, width, height: nominal, the same for every person


def person_boxes(place: Floats) -> Floats:
    """Boxes ``[R, 7]`` of people at places ``[R, 2]``, heading along x."""
    box = np.zeros((len(place), 7))
    box[:, :2] = place
    box[:, 2] = PERSON[2] / 2
    box[:, 4:] = PERSON
    return box


def people_truth(frame: Ints, place: Floats, person: Ints, time: Floats, neutral: Bools | None = None) -> Truth:
    """Truth of people; velocities are backward differences.

    ``frame`` ``[R]`` sorted, ``place`` ``[R, 2]`` m, ``person`` ``[R]``, ``time`` ``[F]`` s, ``neutral`` ``[R]``.
    """
    box = person_boxes(place)
    neutral = np.zeros(len(box), dtype=bool) if neutral is None else neutral
    return Truth(
        start=starts_of_sorted(frame, len(time)),
        box=box,
        velocity=backward_velocity(frame, person, box[:, :2], time),
        class_id=np.zeros(len(box), dtype=np.int64),
        object_id=person,
        eligible=~neutral,
        neutral=neutral,
    )


def people_detections(frame: Ints, place: Floats, score: Floats, frames: int) -> Detections:
    """Detections of people without velocities: ``frame`` ``[R]`` sorted, ``place`` ``[R, 2]`` m, ``score`` ``[R]``."""
    unknown = np.full((len(frame), 2), np.nan)
    class_id = np.zeros(len(frame), dtype=np.int64)
    return Detections(starts_of_sorted(frame, frames), person_boxes(place), unknown, class_id, score)


def extent(box: Floats) -> tuple[float, float, float, float] | None:
    """Least x and y, largest x and y of boxes ``[R, 7]``, m; None without any."""
    if not len(box):
        return None
    low, high = box[:, :2].min(axis=0), box[:, :2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def as_places(detections: Detections) -> Detections:
    """``detections`` as boxes of the nominal person: places are all that such a detector reports.

    A simulated false positive has a heading and a size of its own, which would tell it from a true one.
    """
    return replace(detections, box=person_boxes(detections.box[:, :2]))
