"""Velocities from positions, with nothing of the future in them."""

from __future__ import annotations

import numpy as np

from ..types import Floats, Ints


def backward_velocity(frame: Ints, object_id: Ints, position: Floats, time: Floats) -> Floats:
    """Velocities ``[R, 2]`` m/s since the object's position in the frame before; NaN where it was not there.

    ``frame`` and ``object_id`` ``[R]``, ``position`` ``[R, 2]`` m, ``time`` ``[F]`` s.
    """
    velocity = np.full(position.shape, np.nan)
    order = np.lexsort((frame, object_id))
    before, now = order[:-1], order[1:]
    follows = (object_id[before] == object_id[now]) & (frame[now] - frame[before] == 1)
    before, now = before[follows], now[follows]
    velocity[now] = (position[now] - position[before]) / (time[frame[now]] - time[frame[before]])[:, None]
    return velocity
