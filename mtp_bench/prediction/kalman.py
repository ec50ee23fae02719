"""A Kalman filter over the short past of many tracks at once, in the heading frame of each track.

Along and across the heading the motion is taken as independent: a nearly constant velocity disturbed by white
acceleration (Bar-Shalom, Li, Kirubarajan 2001, ch. 6). Its noise is fitted, see ``motion_noise``.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import ShapeError, require_finite, require_shape
from ..tracking.kernels.compile import kernel
from ..types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class NoiseTable:
    """Noise of the motion model per class; the last axis is along and across the heading."""

    measurement: Floats  # [C] m, standard deviation of a detected position
    jerkiness: Floats  # [C, 2] m/s^1.5, white acceleration while the past is filtered
    speed: Floats  # [C, 2] m/s, prior standard deviation of a velocity never seen
    acceleration: Floats  # [C, 2] m/s^2, standard deviation of the acceleration over the future


def require_noise(noise: NoiseTable) -> None:
    """Raise ShapeError unless the covariances of all states can be positive definite."""
    classes = len(noise.measurement)
    for name, shape in (("measurement", ()), ("jerkiness", (2,)), ("speed", (2,)), ("acceleration", (2,))):
        values = getattr(noise, name)
        require_shape(f"noise.{name}", values, (classes, *shape))
        require_finite(f"noise.{name}", values)
        positive = name in ("measurement", "speed")  # others may be 0
        if not (values > 0 if positive else values >= 0).all():
            expected = "above 0" if positive else "of at least 0"
            raise ShapeError(f"noise.{name} contains {values.min()}, expected numbers {expected}")


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
    n = len(position)
    state = np.empty((n, 2, _STATE))
    # Copies: compiled code takes arrays that may be written, in one order.
    place, seen = np.array(position, dtype=np.float64, order="C"), np.array(valid, dtype=bool, order="C")
    filter_pasts(place, seen, noise.measurement[class_id], noise.jerkiness[class_id], noise.speed[class_id], dt, state)
    covariance = np.stack([state[..., 2:4], state[..., 3:5]], axis=-2)
    return Posterior(state[..., 0].copy(), state[..., 1].copy(), covariance)


_STATE = 5  # of an axis: position, velocity, and variance of position, covariance, variance of velocity


@kernel("void(f8[:, :, ::1], b1[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, f8[:, :, ::1])")
def filter_pasts(
    position: Floats, valid: Bools, measurement: Floats, jerkiness: Floats, speed: Floats, dt: float, state: Floats
) -> None:
    """The states [N, 2, 5] after positions [N, P, 2], with the noise of each track: [N], [N, 2], [N, 2]."""
    for i in range(len(state)):
        for axis in range(2):
            r2, q, prior = measurement[i] ** 2, jerkiness[i, axis] ** 2, speed[i, axis] ** 2
            p, v, pp, pv, vv, started = 0.0, 0.0, 0.0, 0.0, prior, False
            for step in range(position.shape[1]):
                p += v * dt
                pp += 2 * dt * pv + dt * dt * vv + q * dt**3 / 3
                pv += dt * vv + q * dt * dt / 2
                vv += q * dt
                if not valid[i, step]:
                    continue
                if not started:  # the state begins at the first detection, with the prior
                    p, pp, pv, vv, started = position[i, step, axis], r2, 0.0, prior, True
                    continue
                residual, gain_p, gain_v = position[i, step, axis] - p, pp / (pp + r2), pv / (pp + r2)
                p += gain_p * residual
                v += gain_v * residual
                vv -= gain_v * pv
                pp, pv = (1 - gain_p) * pp, (1 - gain_p) * pv
            if not started and q == 0:
                pp += r2  # else the variance is singular
            row = state[i, axis]
            row[0], row[1], row[2], row[3], row[4] = p, v, pp, pv, vv
