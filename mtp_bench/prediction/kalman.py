"""A Kalman filter over the short past of many tracks at once, in the heading frame of each track.

Along and across the heading the motion is taken as independent: a nearly constant velocity disturbed by white
acceleration (Bar-Shalom, Li, Kirubarajan 2001, ch. 6). What it needs to know is fitted, see ``motion_noise``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class NoiseTable:
    """Noise of the motion model per class; the last axis is along and across the heading."""

    measurement: Floats  # [C] m, standard deviation of a detected position
    jerkiness: Floats  # [C, 2] m/s^1.5, white acceleration while the past is filtered
    speed: Floats  # [C, 2] m/s, prior standard deviation of a velocity never seen
    acceleration: Floats  # [C, 2] m/s^2, standard deviation of the acceleration over the future


@dataclass(frozen=True, eq=False)
class Posterior:
    """Position and velocity of N tracks now; axis 1 is along and across the heading."""

    position: Floats  # [N, 2] m from the track's last box centre
    velocity: Floats  # [N, 2] m/s
    covariance: Floats  # [N, 2, 2, 2] of (position, velocity) for each of the two axes


def heading_frame(past: Floats, heading: Floats) -> Floats:
    """Positions [N, P, 2] of past boxes relative to the last one, turned so that axis 0 points along the heading."""
    offset = past[:, :, :2] - past[:, -1:, :2]
    return np.asarray(np.einsum("npi,nij->npj", offset, rotation(heading)))


def rotation(heading: Floats) -> Floats:
    """Matrices [N, 2, 2] whose columns are the axes along and across the heading [N]."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def filtered(position: Floats, valid: Bools, class_id: Ints, noise: NoiseTable, dt: float) -> Posterior:
    """Position, velocity and covariance of tracks now, from their pasts.

    ``position`` [N, P, 2] m, heading frame, oldest first; ``valid`` [N, P]: where a detection was taken; ``class_id``
    [N] chooses the row of ``noise``; ``dt``: frame period, s.
    """
    n, length, _ = position.shape
    r2 = noise.measurement[class_id][:, None] ** 2
    q = noise.jerkiness[class_id] ** 2
    mean_p, mean_v = np.zeros((n, 2)), np.zeros((n, 2))
    pp, pv, vv = np.zeros((n, 2)), np.zeros((n, 2)), noise.speed[class_id] ** 2
    started = np.zeros(n, dtype=bool)
    for step in range(length):
        mean_p = mean_p + mean_v * dt
        pp = pp + 2 * dt * pv + dt * dt * vv + q * dt**3 / 3
        pv = pv + dt * vv + q * dt * dt / 2
        vv = vv + q * dt
        seen = valid[:, step]
        first = (seen & ~started)[:, None]
        started |= seen
        # Before its first detection a track has no state: begin there with the prior.
        mean_p = np.where(first, position[:, step], mean_p)
        pp, pv = np.where(first, r2, pp), np.where(first, 0.0, pv)
        vv = np.where(first, noise.speed[class_id] ** 2, vv)
        use = (seen[:, None] & ~first).astype(np.float64)
        residual = position[:, step] - mean_p
        gain_p, gain_v = use * pp / (pp + r2), use * pv / (pp + r2)
        mean_p = mean_p + gain_p * residual
        mean_v = mean_v + gain_v * residual
        vv = vv - gain_v * pv
        pp, pv = (1 - gain_p) * pp, (1 - gain_p) * pv
    covariance = np.stack([np.stack([pp, pv], axis=-1), np.stack([pv, vv], axis=-1)], axis=-2)
    return Posterior(mean_p, mean_v, covariance)
