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


def as_places(detections: Detections) -> Detections:
    """``detections`` as boxes of the nominal person: places are all that such a detector reports.

    A simulated false positive has a heading and a size of its own, which would give it away.
    """
    return replace(detections, box=person_boxes(detections.box[:, :2]))
