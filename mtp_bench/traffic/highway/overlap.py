"""Overlap of boxes in bird's eye view."""

import numpy as np

from ...core import Bools, Floats, Ints


def overlapping(box: Floats, still: int = 0) -> Ints:
    """Return pairs [n, 2] of rows of boxes [N, 7] that overlap.

    The last ``still`` boxes do not overlap each other.
    """
    x = box[:, 0]
    y = box[:, 1]
    reach = np.hypot(box[:, 4], box[:, 5]) / 2
    moving = slice(len(box) - still)
    dx = x[moving, None] - x
    dy = y[moving, None] - y
    candidates = dx * dx + dy * dy < (reach[moving, None] + reach) ** 2
    first, second = np.nonzero(candidates)
    pairs = np.stack([first, second], axis=1)[first < second]
    if len(pairs) == 0:
        return pairs
    return pairs[boxes_meet(box[pairs[:, 0]], box[pairs[:, 1]])]


def boxes_meet(a: Floats, b: Floats) -> Bools:
    """Mark pairs [n] of boxes a and b [n, 7] that overlap."""
    meets = ~_separated(a, b)
    meets[meets] = ~_separated(b[meets], a[meets])
    return meets


def _separated(a: Floats, b: Floats) -> Bools:
    """Mark boxes a [n, 7] with an axis that separates b."""
    cos = np.cos(a[:, 3])
    sin = np.sin(a[:, 3])
    x = b[:, 0] - a[:, 0]
    y = b[:, 1] - a[:, 1]
    turn = b[:, 3] - a[:, 3]
    cos_turn = np.abs(np.cos(turn))
    sin_turn = np.abs(np.sin(turn))
    along = (a[:, 4] + cos_turn * b[:, 4] + sin_turn * b[:, 5]) / 2
    across = (a[:, 5] + sin_turn * b[:, 4] + cos_turn * b[:, 5]) / 2
    return (np.abs(cos * x + sin * y) > along) | (np.abs(cos * y - sin * x) > across)
