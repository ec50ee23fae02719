"""Who is near whom: what networks see that look at all objects of a frame together.

The windows of many frames may stand in one array; only windows of the same ``moment`` see each other, so that a batch
of whole frames gives what the frames give one by one.
"""

from __future__ import annotations

import numpy as np

from ...types import Ints
from ..windows import TrackWindows
from .layers import Array, namespace
from .local import Arrays, local_inputs


def frame_inputs(windows: TrackWindows, moment: Ints) -> Arrays:
    """`local_inputs`, and of each window where its heading frame is and who is in the same frame.

    place [n, 3] x y m, yaw rad, in the frame of the observations · best [n] · moment [n], equal in the same frame.
    """
    place = windows.box[:, -1, [0, 1, 3]].astype(np.float32)
    return {**local_inputs(windows), "place": place, "best": windows.best.astype(np.float32), "moment": moment}


def in_view(inputs: dict[str, Array]) -> Array:
    """Who sees whom: [n, n] bool, row i sees column j.

    Everybody sees the objects of the same frame that the heaviest hypothesis holds, but himself: a window that ends in
    the very same place is of the same object, in another hypothesis.
    """
    xy, moment = inputs["place"][:, :2], inputs["moment"]
    elsewhere = (xy[:, None] != xy[None]).any(-1)
    return (moment[:, None] == moment[None]) & (inputs["best"][None] > 0) & elsewhere


def offsets(inputs: dict[str, Array], xy: Array) -> Array:
    """From each to each: [n, n, 2] m, place of j less place of i, in the heading frame of i; ``xy`` [n, 2] absolute."""
    return turned(inputs, xy[None] - xy[:, None], -1)


def absolute(inputs: dict[str, Array], xy: Array) -> Array:
    """Places [n, S, 2] given in heading frames, in the frame of the observations."""
    return inputs["place"][:, None, :2] + turned(inputs, xy, 1)


def turned(inputs: dict[str, Array], vectors: Array, sense: int) -> Array:
    """Vectors [n, S, 2] out of the heading frame of each window (``sense`` 1) or into it (-1)."""
    xp, yaw = namespace(vectors), inputs["place"][:, 2]
    cos, sin = xp.cos(yaw)[:, None], sense * xp.sin(yaw)[:, None]
    x, y = vectors[:, :, 0], vectors[:, :, 1]
    return xp.stack([cos * x - sin * y, sin * x + cos * y], -1)
