"""Inputs of networks that forecast all objects of a frame together.

The windows of many frames may stand in one array; only windows of the same ``moment`` see each other, so that a batch
of whole frames gives the same output as the frames one by one.
"""

from __future__ import annotations

import numpy as np

from ...types import Ints
from ..windows import TrackWindows
from .layers import Array, namespace
from .local import Arrays, local_inputs


def frame_inputs(windows: TrackWindows, moment: Ints) -> Arrays:
    """`local_inputs`, and of each window the place of its heading frame and the number of its frame.

    place [n, 3] x y m, yaw rad, in the frame of the observations · best [n] · moment [n], equal in the same frame.
    """
    place = windows.box[:, -1, [0, 1, 3]].astype(np.float32)
    return {**local_inputs(windows), "place": place, "best": windows.best.astype(np.float32), "moment": moment}


def in_view(inputs: dict[str, Array]) -> Array:
    """Mask [n, n]: window i sees window j.

    A window sees the objects of the same frame that the heaviest hypothesis holds, other than its own: a window that
    ends in exactly the same place is of the same object, in another hypothesis.
    """
    xy, moment = inputs["place"][:, :2], inputs["moment"]
    elsewhere = (xy[:, None] != xy[None]).any(-1)
    return (moment[:, None] == moment[None]) & (inputs["best"][None] > 0) & elsewhere


def offsets(inputs: dict[str, Array], xy: Array) -> Array:
    """Offsets [n, n, 2] m from i to j, in the heading frame of i; ``xy`` [n, 2] absolute."""
    return turned(inputs, xy[None] - xy[:, None], -1)


def absolute(inputs: dict[str, Array], xy: Array) -> Array:
    """Positions [n, S, 2] of heading frames, in the frame of the observations."""
    return inputs["place"][:, None, :2] + turned(inputs, xy, 1)


def turned(inputs: dict[str, Array], vectors: Array, sense: int) -> Array:
    """Vectors [n, S, 2] out of the heading frame of each window (``sense`` 1) or into it (-1)."""
    xp, yaw = namespace(vectors), inputs["place"][:, 2]
    cos, sin = xp.cos(yaw)[:, None], sense * xp.sin(yaw)[:, None]
    x, y = vectors[:, :, 0], vectors[:, :, 1]
    return xp.stack([cos * x - sin * y, sin * x + cos * y], -1)
