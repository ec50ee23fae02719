"""People of whom only the place on the ground is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..types import Detections, Floats

PERSON = 0.6, 0.6, 1.75  # m, length, width, height: nominal, the same for everybody


def person_boxes(place: Floats) -> Floats:
    """Boxes ``[R, 7]`` of people who stand at places ``[R, 2]``, heading along x."""
    box = np.zeros((len(place), 7))
    box[:, :2] = place
    box[:, 2] = PERSON[2] / 2
    box[:, 4:] = PERSON
    return box


def extent(box: Floats) -> tuple[float, float, float, float] | None:
    """Least x and y, largest x and y of boxes ``[R, 7]``, m; None without any."""
    if not len(box):
        return None
    low, high = box[:, :2].min(axis=0), box[:, :2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def as_places(detections: Detections) -> Detections:
    """``detections`` as boxes of the nominal person: places are all that such a detector reports.

    A simulated false positive has a heading and a size of its own, which would give it away.
    """
    return replace(detections, box=person_boxes(detections.box[:, :2]))
