"""Classes and sizes that clutter has: those of the true boxes which it could be taken for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Floats, Ints, Truth
from .profile import Profile


@dataclass(frozen=True, eq=False)
class Labels:
    """What the clutter of one noise is reported as in a scene."""

    class_id: Ints  # [K]
    share: Floats  # [K] sum 1
    size: Floats  # [K, 3] m, mean length, width, height


def labels_of(truth: Truth, classes: Sequence[str], profile: Profile, own: str) -> Labels | None:
    """The classes of the task that have the noise of ``own``, by their number of true boxes in the scene.

    Where it has none: the class ``own``, or the first with its noise; None where no class of the task has it.
    """
    having = [class_id for class_id, name in enumerate(classes) if profile.alike.get(name, name) == own]
    boxes = np.bincount(truth.class_id, minlength=len(classes))
    there = [class_id for class_id in having if boxes[class_id]]
    if there:
        size = [truth.box[truth.class_id == class_id, 4:].mean(axis=0) for class_id in there]
        return Labels(np.array(there), boxes[there] / boxes[there].sum(), np.array(size))
    false = profile.classes[own].false_positives
    if not having or false is None:
        return None
    alone = classes.index(own) if own in classes and classes.index(own) in having else having[0]
    return Labels(np.array([alone]), np.ones(1), np.array([false.size]))
