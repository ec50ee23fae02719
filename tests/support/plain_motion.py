"""AB3DMOT's constant-velocity Kalman filter, batched over tracks (Weng et al. 2020).

The state is ``x y z yaw l w h vx vy vz`` per frame. With its diagonal noise the filter decouples exactly into one 2 x 2
covariance shared by x, y and z, and one variance shared by yaw, l, w and h. Where detections carry a velocity it is one
more measurement, which AB3DMOT has not: at 2 Hz a fast vehicle is out of every gate without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtp_bench.geometry import wrap_angle
from mtp_bench.types import Floats, Ints

MEASUREMENT_VARIANCE = 1.0
VELOCITY_DEVIATION = 0.5  # m/s, of a measured velocity
POSITION_VARIANCE_AT_BIRTH = 10.0
VELOCITY_VARIANCE_AT_BIRTH = 10_000.0
POSITION_NOISE = 1.0  # per frame
VELOCITY_NOISE = 0.01  # per frame


@dataclass(frozen=True, eq=False)
class MotionState:
    """State of N tracks."""

    mean: Floats  # [N, 10]
    covariance: Floats  # [N, 2, 2] of position and velocity along each axis
    variance: Floats  # [N] of yaw, l, w, h

    def take(self, index: Ints) -> MotionState:
        """Rows ``index`` of the state."""
        return MotionState(self.mean[index], self.covariance[index], self.variance[index])


def born(box: Floats, velocity: Floats | None = None, dt: float = 1.0) -> MotionState:
    """State of new tracks at detected boxes [n, 7], with their velocities [n, 2] in m/s; ``dt`` s per frame."""
    n = len(box)
    covariance = np.diag([POSITION_VARIANCE_AT_BIRTH, VELOCITY_VARIANCE_AT_BIRTH])
    state = MotionState(
        np.concatenate([box, np.zeros((n, 3))], axis=1),
        np.broadcast_to(covariance, (n, 2, 2)).copy(),
        np.full(n, POSITION_VARIANCE_AT_BIRTH),
    )
    return state if velocity is None else _with_velocity(state, velocity, dt)


def predicted(state: MotionState) -> MotionState:
    """State one frame later."""
    mean = state.mean.copy()
    mean[:, :3] += mean[:, 7:]
    (pp, pv), (vp, vv) = np.moveaxis(state.covariance, 0, -1)
    covariance = np.empty_like(state.covariance)
    covariance[:, 0, 0] = pp + pv + vp + vv + POSITION_NOISE
    covariance[:, 0, 1] = pv + vv
    covariance[:, 1, 0] = vp + vv
    covariance[:, 1, 1] = vv + VELOCITY_NOISE
    return MotionState(mean, covariance, state.variance + POSITION_NOISE)


def updated(state: MotionState, box: Floats, velocity: Floats | None = None, dt: float = 1.0) -> MotionState:
    """State after taking one detected box [n, 7] each, with its velocity [n, 2] in m/s; ``dt`` s per frame.

    A detection that faces the other way is turned by pi: a box detector confuses front and back more often than a
    vehicle turns round within a frame.
    """
    mean = state.mean.copy()
    innovation = box - mean[:, :7]
    turn = wrap_angle(innovation[:, 3])
    innovation[:, 3] = np.where(np.abs(turn) > np.pi / 2, wrap_angle(turn + np.pi), turn)
    gain = state.covariance[:, :, 0] / (state.covariance[:, :1, 0] + MEASUREMENT_VARIANCE)
    mean[:, :3] += gain[:, :1] * innovation[:, :3]
    mean[:, 7:] += gain[:, 1:] * innovation[:, :3]
    shape_gain = state.variance / (state.variance + MEASUREMENT_VARIANCE)
    mean[:, 3:7] += shape_gain[:, None] * innovation[:, 3:]
    mean[:, 3] = wrap_angle(mean[:, 3])
    covariance = state.covariance - gain[:, :, None] * state.covariance[:, :1, :]
    state = MotionState(mean, covariance, (1 - shape_gain) * state.variance)
    return state if velocity is None else _with_velocity(state, velocity, dt)


def _with_velocity(state: MotionState, velocity: Floats, dt: float) -> MotionState:
    """State after measuring velocities [n, 2] in m/s; nothing moves up or down. Exactly 0, 0 means not measured."""
    mean = state.mean.copy()
    innovation = np.concatenate([velocity * dt, np.zeros((len(velocity), 1))], axis=1) - mean[:, 7:]
    gain = state.covariance[:, :, 1] / (state.covariance[:, 1:, 1] + (VELOCITY_DEVIATION * dt) ** 2)
    gain = gain * velocity.any(axis=1, keepdims=True)
    mean[:, :3] += gain[:, :1] * innovation
    mean[:, 7:] += gain[:, 1:] * innovation
    covariance = state.covariance - gain[:, :, None] * state.covariance[:, 1:, :]
    return MotionState(mean, covariance, state.variance)
