"""Velocities from positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..types import Floats, Ints, Truth


def backward_velocity(frame: Ints, object_id: Ints, position: Floats, time: Floats) -> Floats:
    """Velocities ``[R, 2]`` m/s since the object's position in the frame before; NaN if it was absent.

    They use no later frame.

    ``frame`` and ``object_id`` ``[R]``, ``position`` ``[R, 2]`` m, ``time`` ``[F]`` s.
    """
    velocity = np.full(position.shape, np.nan)
    order = np.lexsort((frame, object_id))
    before, now = order[:-1], order[1:]
    follows = (object_id[before] == object_id[now]) & (frame[now] - frame[before] == 1)
    before, now = before[follows], now[follows]
    velocity[now] = (position[now] - position[before]) / (time[frame[now]] - time[frame[before]])[:, None]
    return velocity


def looking_back(truth: Truth, time: Floats) -> Truth:
    """``truth`` with backward velocities: which an agent may see. ``time`` ``[F]`` s."""
    velocity = backward_velocity(truth.frame_of_rows, truth.object_id, truth.box[:, :2], time)
    return replace(truth, velocity=velocity)


def central_velocity(frame: Ints, object_id: Ints, position: Floats, period: float) -> Floats:
    """Velocities ``[R, 2]`` m/s from the object's positions ``[R, 2]`` one frame before and after; NaN without both.

    They show where the object is in the next frame: a source of such velocities has the trait ``velocity_ahead``.
    """
    velocity = np.full(position.shape, np.nan)
    order = np.lexsort((frame, object_id))
    before, here, after = order[:-2], order[1:-1], order[2:]
    follows = (object_id[before] == object_id[after]) & (frame[after] - frame[before] == 2)
    before, here, after = before[follows], here[follows], after[follows]
    velocity[here] = (position[after] - position[before]) / (2 * period)
    return velocity
