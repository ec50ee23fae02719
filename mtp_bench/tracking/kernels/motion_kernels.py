"""AB3DMOT's constant-velocity Kalman filter for many tracks at once (Weng et al. 2020).

The state is ``x y z yaw l w h vx vy vz`` per frame. With its diagonal noise the filter
decouples exactly into one 2 x 2 covariance shared by x, y and z, and one variance
shared by yaw, l, w and h: 15 numbers in a row, without temporary arrays. Where
detections carry a velocity it is one more measurement, which AB3DMOT has not: at 2 Hz a
fast vehicle is out of every gate without it.
"""

import math

from ...core import Floats, Ints
from .compile import kernel, part

MEASUREMENT_VARIANCE = 1.0
VELOCITY_DEVIATION = 0.5  # m/s, of a measured velocity
POSITION_VARIANCE_AT_BIRTH = 10.0
VELOCITY_VARIANCE_AT_BIRTH = 10_000.0
POSITION_NOISE = 1.0  # per frame
VELOCITY_NOISE = 0.01  # per frame

STATE = 15  # x y z yaw l w h vx vy vz, then covariance and variance:
_PP, _PV, _VP, _VV, _SHAPE = range(10, STATE)
_PI = math.pi
_TWO_PI = 2 * math.pi
_RIGHT_ANGLE = math.pi / 2


@part
def wrap(angle: float) -> float:
    """Bring an angle in radians into [-pi, pi).

    The result is that of `geometry.wrap_angle` to the bit.
    """
    shifted_angle = angle + _PI
    if not 0.0 <= shifted_angle < _TWO_PI:
        shifted_angle %= _TWO_PI
    return shifted_angle - _PI


@kernel("void(f8[:, ::1])")
def predict(state: Floats) -> None:
    """Move all states [N, 15] one frame on, in place."""
    for i in range(len(state)):
        for axis in range(3):
            state[i, axis] += state[i, 7 + axis]
        pp = state[i, _PP]
        pv = state[i, _PV]
        vp = state[i, _VP]
        vv = state[i, _VV]
        state[i, _PP] = pp + pv + vp + vv + POSITION_NOISE
        state[i, _PV] = pv + vv
        state[i, _VP] = vp + vv
        state[i, _VV] = vv + VELOCITY_NOISE
        state[i, _SHAPE] += POSITION_NOISE


@part
def _take_box(state: Floats, i: int, box: Floats, detection: int) -> None:
    """Update state ``i`` with a detected box, in place.

    A detection that faces the other way is turned by pi.
    """
    pp = state[i, _PP]
    pv = state[i, _PV]
    vp = state[i, _VP]
    vv = state[i, _VV]
    gain = pp / (pp + MEASUREMENT_VARIANCE)
    velocity_gain = vp / (pp + MEASUREMENT_VARIANCE)
    for axis in range(3):
        innovation = box[detection, axis] - state[i, axis]
        state[i, axis] += gain * innovation
        state[i, 7 + axis] += velocity_gain * innovation
    shape_gain = state[i, _SHAPE] / (state[i, _SHAPE] + MEASUREMENT_VARIANCE)
    yaw_innovation = wrap(box[detection, 3] - state[i, 3])
    if abs(yaw_innovation) > _RIGHT_ANGLE:
        yaw_innovation = wrap(yaw_innovation + _PI)
    state[i, 3] = wrap(state[i, 3] + shape_gain * yaw_innovation)
    for side in range(4, 7):
        state[i, side] += shape_gain * (box[detection, side] - state[i, side])
    state[i, _PP] = pp - gain * pp
    state[i, _PV] = pv - gain * pv
    state[i, _VP] = vp - velocity_gain * pp
    state[i, _VV] = vv - velocity_gain * pv
    state[i, _SHAPE] = (1 - shape_gain) * state[i, _SHAPE]


@part
def _take_velocity(
    state: Floats, i: int, velocity: Floats, detection: int, dt: float
) -> None:
    """Update state ``i`` with a measured velocity in m/s, in place.

    Exactly 0, 0 means not measured.
    """
    pp = state[i, _PP]
    pv = state[i, _PV]
    vp = state[i, _VP]
    vv = state[i, _VV]
    deviation = VELOCITY_DEVIATION * dt
    measured = 0.0
    if velocity[detection, 0] != 0.0 or velocity[detection, 1] != 0.0:
        measured = 1.0
    gain = pv / (vv + deviation * deviation) * measured
    velocity_gain = vv / (vv + deviation * deviation) * measured
    for axis in range(3):
        frame_shift = 0.0  # nothing moves up or down
        if axis < 2:
            frame_shift = velocity[detection, axis] * dt
        innovation = frame_shift - state[i, 7 + axis]
        state[i, axis] += gain * innovation
        state[i, 7 + axis] += velocity_gain * innovation
    state[i, _PP] = pp - gain * vp
    state[i, _PV] = pv - gain * vv
    state[i, _VP] = vp - velocity_gain * vp
    state[i, _VV] = vv - velocity_gain * vv


@part
def _bear(state: Floats, i: int, box: Floats, detection: int) -> None:
    """Make state ``i`` a new track at a detected box."""
    for k in range(7):
        state[i, k] = box[detection, k]
    for k in range(7, STATE):
        state[i, k] = 0.0
    state[i, _PP] = POSITION_VARIANCE_AT_BIRTH
    state[i, _VV] = VELOCITY_VARIANCE_AT_BIRTH
    state[i, _SHAPE] = POSITION_VARIANCE_AT_BIRTH


@kernel(
    "void(f8[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8, "
    "f8[:, ::1], f8[:, ::1])"
)
def update_pairs(
    state: Floats,  # [N, 15] predicted
    leaf: Ints,  # [E] state of each pair, -1: a new track
    detection: Ints,  # [E] detection of each pair, -1: none taken
    box: Floats,  # [D, 7]
    velocity: Floats,  # [D, 2] m/s; [0, 2] where velocities are not measured
    dt: float,  # s per frame
    new_state: Floats,  # [E or more, 15]
    measured: Floats,  # [E or more, 7]
) -> None:
    """Write state and box of each pair of leaf and detection.

    Not both may be -1. The state is updated, merely predicted, or born. The box is the
    detected one, or that of the state where no detection is taken.
    """
    for e in range(len(leaf)):
        d = detection[e]
        if leaf[e] < 0:
            _bear(new_state, e, box, d)
        else:
            for k in range(STATE):
                new_state[e, k] = state[leaf[e], k]
            if d >= 0:
                _take_box(new_state, e, box, d)
        if len(velocity) > 0 and d >= 0:
            _take_velocity(new_state, e, velocity, d, dt)
        for k in range(7):
            measured[e, k] = box[d, k] if d >= 0 else new_state[e, k]
