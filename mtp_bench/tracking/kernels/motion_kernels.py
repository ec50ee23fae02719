"""AB3DMOT's constant-velocity Kalman filter for many tracks at once, without temporary arrays (Weng et al. 2020).

The state is ``x y z yaw l w h vx vy vz`` per frame. With its diagonal noise the filter decouples exactly into one 2 x 2
covariance shared by x, y and z, and one variance shared by yaw, l, w and h. Where detections carry a velocity it is one
more measurement, which AB3DMOT has not: at 2 Hz a fast vehicle is out of every gate without it.
"""

from __future__ import annotations

import math

from ...types import Floats, Ints
from .compile import kernel

MEASUREMENT_VARIANCE = 1.0
VELOCITY_DEVIATION = 0.5  # m/s, of a measured velocity
POSITION_VARIANCE_AT_BIRTH = 10.0
VELOCITY_VARIANCE_AT_BIRTH = 10_000.0
POSITION_NOISE = 1.0  # per frame
VELOCITY_NOISE = 0.01  # per frame

_PI, _TWO_PI, _RIGHT = math.pi, 2 * math.pi, math.pi / 2


@kernel("f8(f8)")
def wrap(angle: float) -> float:
    """``angle`` in radians, brought into [-pi, pi): `geometry.wrap_angle` to the bit."""
    turned = angle + _PI
    if not 0.0 <= turned < _TWO_PI:
        turned %= _TWO_PI
    return turned - _PI


@kernel("void(f8[:, ::1], f8[:, :, ::1], f8[::1])")
def predict(mean: Floats, covariance: Floats, variance: Floats) -> None:
    """Move all states one frame on, in place: mean [N, 10], covariance [N, 2, 2], variance [N]."""
    for i in range(len(mean)):
        for axis in range(3):
            mean[i, axis] += mean[i, 7 + axis]
        pp, pv, vp, vv = covariance[i, 0, 0], covariance[i, 0, 1], covariance[i, 1, 0], covariance[i, 1, 1]
        covariance[i, 0, 0] = pp + pv + vp + vv + POSITION_NOISE
        covariance[i, 0, 1] = pv + vv
        covariance[i, 1, 0] = vp + vv
        covariance[i, 1, 1] = vv + VELOCITY_NOISE
        variance[i] += POSITION_NOISE


@kernel("void(f8[:, ::1], f8[:, :, ::1], f8[::1], i8, f8[:, ::1], i8)")
def _take_box(mean: Floats, covariance: Floats, variance: Floats, at: int, box: Floats, detection: int) -> None:
    """Update state ``at`` with a detected box, in place. A detection that faces the other way is turned by pi."""
    pp, pv, vp, vv = covariance[at, 0, 0], covariance[at, 0, 1], covariance[at, 1, 0], covariance[at, 1, 1]
    gain, velocity_gain = pp / (pp + MEASUREMENT_VARIANCE), vp / (pp + MEASUREMENT_VARIANCE)
    for axis in range(3):
        innovation = box[detection, axis] - mean[at, axis]
        mean[at, axis] += gain * innovation
        mean[at, 7 + axis] += velocity_gain * innovation
    shape_gain = variance[at] / (variance[at] + MEASUREMENT_VARIANCE)
    turn = wrap(box[detection, 3] - mean[at, 3])
    if abs(turn) > _RIGHT:
        turn = wrap(turn + _PI)
    mean[at, 3] = wrap(mean[at, 3] + shape_gain * turn)
    for side in range(4, 7):
        mean[at, side] += shape_gain * (box[detection, side] - mean[at, side])
    covariance[at, 0, 0] = pp - gain * pp
    covariance[at, 0, 1] = pv - gain * pv
    covariance[at, 1, 0] = vp - velocity_gain * pp
    covariance[at, 1, 1] = vv - velocity_gain * pv
    variance[at] = (1 - shape_gain) * variance[at]


@kernel("void(f8[:, ::1], f8[:, :, ::1], i8, f8[:, ::1], i8, f8)")
def _take_velocity(mean: Floats, covariance: Floats, at: int, velocity: Floats, detection: int, dt: float) -> None:
    """Update state ``at`` with a measured velocity in m/s, in place; exactly 0, 0 means not measured."""
    pp, pv, vp, vv = covariance[at, 0, 0], covariance[at, 0, 1], covariance[at, 1, 0], covariance[at, 1, 1]
    deviation = VELOCITY_DEVIATION * dt
    measured = 1.0 if velocity[detection, 0] != 0.0 or velocity[detection, 1] != 0.0 else 0.0
    gain = pv / (vv + deviation * deviation) * measured
    velocity_gain = vv / (vv + deviation * deviation) * measured
    for axis in range(3):
        moved = velocity[detection, axis] * dt if axis < 2 else 0.0  # nothing moves up or down
        innovation = moved - mean[at, 7 + axis]
        mean[at, axis] += gain * innovation
        mean[at, 7 + axis] += velocity_gain * innovation
    covariance[at, 0, 0] = pp - gain * vp
    covariance[at, 0, 1] = pv - gain * vv
    covariance[at, 1, 0] = vp - velocity_gain * vp
    covariance[at, 1, 1] = vv - velocity_gain * vv


@kernel("void(f8[:, ::1], f8[:, :, ::1], f8[::1], i8, f8[:, ::1], i8)")
def _bear(mean: Floats, covariance: Floats, variance: Floats, at: int, box: Floats, detection: int) -> None:
    """Let state ``at`` be that of a new track at a detected box."""
    for k in range(10):
        mean[at, k] = box[detection, k] if k < 7 else 0.0
    covariance[at, 0, 0] = POSITION_VARIANCE_AT_BIRTH
    covariance[at, 0, 1] = covariance[at, 1, 0] = 0.0
    covariance[at, 1, 1] = VELOCITY_VARIANCE_AT_BIRTH
    variance[at] = POSITION_VARIANCE_AT_BIRTH


@kernel(
    "void(f8[:, ::1], f8[:, :, ::1], f8[::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], b1, f8,"
    " f8[:, ::1], f8[:, :, ::1], f8[::1])"
)
def update_pairs(
    mean: Floats,  # [N, 10] predicted states
    covariance: Floats,  # [N, 2, 2]
    variance: Floats,  # [N]
    leaf: Ints,  # [E] state of each pair, -1: a new track
    detection: Ints,  # [E] detection of each pair, -1: none taken
    box: Floats,  # [D, 7]
    velocity: Floats,  # [D, 2] m/s; not read without has_velocity
    has_velocity: bool,
    dt: float,  # s per frame
    out_mean: Floats,  # [E or more, 10]
    out_covariance: Floats,  # [E or more, 2, 2]
    out_variance: Floats,  # [E or more]
) -> None:
    """Write the state of each pair (leaf, detection): updated, merely predicted, or born. Not both may be -1."""
    for e in range(len(leaf)):
        if leaf[e] < 0:
            _bear(out_mean, out_covariance, out_variance, e, box, detection[e])
        else:
            for k in range(10):
                out_mean[e, k] = mean[leaf[e], k]
            for k in range(4):
                out_covariance[e, k // 2, k % 2] = covariance[leaf[e], k // 2, k % 2]
            out_variance[e] = variance[leaf[e]]
            if detection[e] >= 0:
                _take_box(out_mean, out_covariance, out_variance, e, box, detection[e])
        if has_velocity and detection[e] >= 0:
            _take_velocity(out_mean, out_covariance, e, velocity, detection[e], dt)
