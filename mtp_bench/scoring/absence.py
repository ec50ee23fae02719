"""Reasons why a target may have no forecast, as its detections tell (docs/definitions, "Parts of the error")."""

from enum import IntEnum

import numpy as np

from ..cards import Card
from ..types import Bools, Ints, Scene
from .events import history
from .holes import separated_truth
from .pairs import near_pairs
from .targets import Targets


class AbsentCause(IntEnum):
    """The first cause that holds for a target; the detections decide, not the agent."""

    NO_FORECAST = 0  # a detection of its class lies inside the forecast gate
    OTHER_CLASS = 1  # one of another class does
    OFF_PLACE = 2  # one of its class lies within two gates
    UNDETECTED_NEW = 3  # none of its class lay inside the gate in any earlier frame of the object
    UNDETECTED_SEEN = 4


def absent_causes(scene: Scene, targets: Targets, card: Card) -> Ints:
    """Values of `AbsentCause` [n] of the ``targets``; frames in which an object is neutral are frames of it too.

    After a hole in time an object is another one.
    """
    truth, seen = separated_truth(scene, card), scene.detections
    gate = np.asarray(card.per_class(card.task.forecast_gate), dtype=np.float64)
    at = truth.frame_of_rows, truth.box[:, :2]
    row, column, distance = near_pairs(*at, seen.frame_of_rows, seen.box[:, :2], 2 * float(gate.max()))
    limit = gate[truth.class_id[row]]
    own, inside = truth.class_id[row] == seen.class_id[column], distance <= limit

    def of_targets(pairs: Bools) -> Bools:
        return np.bincount(row[pairs], minlength=len(truth.box))[targets.row] > 0

    objects = history(at[0], truth.object_id)
    now = np.bincount(row[own & inside], minlength=len(truth.box))[objects.order] > 0
    detected = np.cumsum(now)
    before = np.maximum.accumulate(np.where(objects.follows, 0, detected - now))  # in rows of other objects
    ever = np.zeros(len(now), dtype=bool)
    ever[objects.order] = detected > before
    holds = [of_targets(own & inside), of_targets(~own & inside), of_targets(own & (distance <= 2 * limit))]
    return np.select([*holds, ~ever[targets.row]], list(AbsentCause)[:4], AbsentCause.UNDETECTED_SEEN)
