"""Which detection belongs to which true box: the pairs that noise is measured on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry import center_distance
from ...types import Bools, Detections, Floats, Ints, Truth

_GATES = {"pedestrian": 1.0, "cyclist": 1.5, "bicycle": 1.5, "motorcycle": 1.5}
_VEHICLE_GATE = 2.0
_BESIDE = 0.75  # m: a second detection that near to the first one is of the same object


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of true boxes and detections of a scene."""

    detection: Ints  # [R] per true box: row of its detection, -1 where it is undetected
    false: Bools  # [D] detections without a true box, those beside neutral true boxes left out
    duplicate: Bools  # [D] false ones beside the detection of a true box


def gate(class_name: str) -> float:
    """Largest distance (BEV, metres) of a detection from its true box; 2 m unless the class is a small one."""
    return _GATES.get(class_name, _VEHICLE_GATE)


def at_floor(detections: Detections, classes: Sequence[str], floor: Mapping[str, float] | None) -> Detections:
    """The detections whose score reaches the ``floor`` of their class; classes without one keep all."""
    if not floor:
        return detections
    least = np.array([floor.get(name, -np.inf) for name in classes])
    return detections.those(detections.score >= least[detections.class_id])


def match(truth: Truth, detections: Detections, classes: Sequence[str]) -> Matches:
    """Match true boxes and detections one to one, frame by frame within each class.

    As many pairs as the gates allow, and among those answers the least sum of BEV distances. Neutral true boxes take
    part, so that they absorb detections that are theirs.
    """
    detection = np.full(len(truth.box), -1)
    false = np.ones(len(detections.box), dtype=bool)
    duplicate = np.zeros(len(detections.box), dtype=bool)
    for t in range(truth.frames):
        true_rows, rows = truth.rows(t), detections.rows(t)
        for class_id, name in enumerate(classes):
            i = true_rows.start + np.flatnonzero(truth.class_id[true_rows] == class_id)
            j = rows.start + np.flatnonzero(detections.class_id[rows] == class_id)
            if not len(i) or not len(j):
                continue
            distance = center_distance(truth.box[i, None], detections.box[None, j])
            pair_i, pair_j = _assign(distance, gate(name))
            detection[i[pair_i]] = j[pair_j]
            near = distance <= gate(name)
            false[j[pair_j]] = False
            false[j[near[truth.neutral[i]].any(axis=0)]] = False
            beside = center_distance(detections.box[j[pair_j], None], detections.box[None, j]) <= _BESIDE
            duplicate[j[beside.any(axis=0)]] = True
    return Matches(detection=detection, false=false, duplicate=duplicate & false)


def _assign(distance: Floats, largest: float) -> tuple[Ints, Ints]:
    """Rows and columns of the pairs within ``largest``: the most pairs first, then the least sum."""
    from scipy.optimize import linear_sum_assignment

    near = distance <= largest
    beyond = (min(distance.shape) + 1) * (largest + 1.0)  # dearer than all pairs together
    row, column = linear_sum_assignment(np.where(near, distance, beyond))
    kept = near[row, column]
    return row[kept], column[kept]
