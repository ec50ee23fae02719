"""Targets whose error is blamed on the data, since a doubt touches them."""

from collections.abc import Sequence

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints
from ..doubts import Doubt
from ..scoring import BELOW_THRESHOLD, PART_NAMES, blame


def doubt_numbers(
    doubts: Sequence[Doubt], card: Card, frame: Ints, object_id: Ints
) -> Ints:
    """Return the first of ``doubts`` [n] that touches a past or future, or -1.

    ``frame`` and ``object_id`` [n] are of true boxes of the scene of the doubts.
    """
    numbers = np.full(len(frame), -1)
    for number, doubt in reversed(list(enumerate(doubts))):
        is_touched = frame + card.task.future >= doubt.first
        if doubt.last >= 0:  # else until the end
            is_touched &= frame - card.task.past < doubt.last
        if doubt.objects:
            is_touched &= np.isin(object_id, doubt.objects)
        numbers[is_touched] = number
    return numbers


def blamed_parts(part: Floats, is_doubted: Bools) -> Floats:
    """Return parts [n, len(PARTS)], with the blame of doubted targets on the data.

    ``part`` [n, len(PART_NAMES)] is as without a doubt, m; NaN stays NaN.
    """
    is_blame = np.array(list(PART_NAMES.values())) != BELOW_THRESHOLD
    kept = part * ~(is_doubted[:, None] & is_blame)
    return np.column_stack([kept, blame(part) * is_doubted])
