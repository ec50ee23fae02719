"""Whether boxes on the road overlap, by their true sizes."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints


def overlapping(box: Floats) -> Ints:
    """Pairs ``[n, 2]`` of rows of boxes ``[N, 7]`` that overlap in bird's eye view (separating axes)."""
    if len(box) < 2:
        return np.empty((0, 2), dtype=np.int64)
    reach = np.hypot(box[:, 4], box[:, 5]) / 2
    dx, dy = box[:, 0, None] - box[:, 0], box[:, 1, None] - box[:, 1]
    near = np.triu(dx * dx + dy * dy < (reach[:, None] + reach) ** 2, 1)
    pairs: Ints = np.argwhere(near)
    if len(pairs) == 0:
        return pairs
    a, b = box[pairs[:, 0]], box[pairs[:, 1]]
    together: Ints = pairs[~(_separated(a, b) | _separated(b, a))]
    return together


def _separated(a: Floats, b: Floats) -> Bools:
    """Whether an axis of box a ``[n, 7]`` separates it from box b: ``[n]`` bool."""
    cos, sin = np.cos(a[:, 3]), np.sin(a[:, 3])
    x, y = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    turn = b[:, 3] - a[:, 3]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    along = (a[:, 4] + c * b[:, 4] + s * b[:, 5]) / 2
    across = (a[:, 5] + s * b[:, 4] + c * b[:, 5]) / 2
    return (np.abs(cos * x + sin * y) > along) | (np.abs(cos * y - sin * x) > across)
