"""AB3DMOT's constant-velocity Kalman filter for many tracks at once, without temporary arrays (Weng et al. 2020).

The state is ``x y z yaw l w h vx vy vz`` per frame. With its diagonal noise the filter decouples exactly into one 2 x 2
covariance shared by x, y and z, and one variance shared by yaw, l, w and h: 15 numbers in a row. Where detections carry
a velocity it is one more measurement, which AB3DMOT has not: at 2 Hz a fast vehicle is out of every gate without it.
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
_RIGHT = math.pi / 2


@part
def wrap(angle: float) -> float:
    """``angle`` in radians, brought into [-pi, pi): `geometry.wrap_angle` to the bit."""
    turned = angle + _PI
    if not 0.0 <= turned < _TWO_PI:
        turned %= _TWO_PI
    return turned - _PI


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
def _take_box(state: Floats, at: int, box: Floats, detection: int) -> None:
    """Update state ``at`` with a detected box, in place. A detection that faces the other way is turned by pi."""
    pp = state[at, _PP]
    pv = state[at, _PV]
    vp = state[at, _VP]
    vv = state[at, _VV]
    gain = pp / (pp + MEASUREMENT_VARIANCE)
    velocity_gain = vp / (pp + MEASUREMENT_VARIANCE)
    for axis in range(3):
        innovation = box[detection, axis] - state[at, axis]
        state[at, axis] += gain * innovation
        state[at, 7 + axis] += velocity_gain * innovation
    shape_gain = state[at, _SHAPE] / (state[at, _SHAPE] + MEASUREMENT_VARIANCE)
    turn = wrap(box[detection, 3] - state[at, 3])
    if abs(turn) > _RIGHT:
        turn = wrap(turn + _PI)
    state[at, 3] = wrap(state[at, 3] + shape_gain * turn)
    for side in range(4, 7):
        state[at, side] += shape_gain * (box[detection, side] - state[at, side])
    state[at, _PP] = pp - gain * pp
    state[at, _PV] = pv - gain * pv
    state[at, _VP] = vp - velocity_gain * pp
    state[at, _VV] = vv - velocity_gain * pv
    state[at, _SHAPE] = (1 - shape_gain) * state[at, _SHAPE]


@part
def _take_velocity(
    state: Floats, at: int, velocity: Floats, detection: int, dt: float
) -> None:
    """Update state ``at`` with a measured velocity in m/s, in place; exactly 0, 0 means not measured."""
    pp = state[at, _PP]
    pv = state[at, _PV]
    vp = state[at, _VP]
    vv = state[at, _VV]
    deviation = VELOCITY_DEVIATION * dt
    measured = (
        1.0 if velocity[detection, 0] != 0.0 or velocity[detection, 1] != 0.0 else 0.0
    )
    gain = pv / (vv + deviation * deviation) * measured
    velocity_gain = vv / (vv + deviation * deviation) * measured
    for axis in range(3):
        moved = (
            velocity[detection, axis] * dt if axis < 2 else 0.0
        )  # nothing moves up or down
        innovation = moved - state[at, 7 + axis]
        state[at, axis] += gain * innovation
        state[at, 7 + axis] += velocity_gain * innovation
    state[at, _PP] = pp - gain * vp
    state[at, _PV] = pv - gain * vv
    state[at, _VP] = vp - velocity_gain * vp
    state[at, _VV] = vv - velocity_gain * vv


@part
def _bear(state: Floats, at: int, box: Floats, detection: int) -> None:
    """Let state ``at`` be that of a new track at a detected box."""
    for k in range(STATE):
        state[at, k] = box[detection, k] if k < 7 else 0.0
    state[at, _PP] = POSITION_VARIANCE_AT_BIRTH
    state[at, _VV] = VELOCITY_VARIANCE_AT_BIRTH
    state[at, _SHAPE] = POSITION_VARIANCE_AT_BIRTH


@kernel(
    "void(f8[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[:, ::1])"
)
def update_pairs(
    state: Floats,  # [N, 15] predicted
    leaf: Ints,  # [E] state of each pair, -1: a new track
    detection: Ints,  # [E] detection of each pair, -1: none taken
    box: Floats,  # [D, 7]
    velocity: Floats,  # [D, 2] m/s; [0, 2] where velocities are not measured
    dt: float,  # s per frame
    out: Floats,  # [E or more, 15]
    measured: Floats,  # [E or more, 7] detected boxes; that of the state where none is taken
) -> None:
    """Write state and box of each pair (leaf, detection): updated, merely predicted, or born. Not both may be -1."""
    for e in range(len(leaf)):
        if leaf[e] < 0:
            _bear(out, e, box, detection[e])
        else:
            for k in range(STATE):
                out[e, k] = state[leaf[e], k]
            if detection[e] >= 0:
                _take_box(out, e, box, detection[e])
        if len(velocity) > 0 and detection[e] >= 0:
            _take_velocity(out, e, velocity, detection[e], dt)
        for k in range(7):
            measured[e, k] = box[detection[e], k] if detection[e] >= 0 else out[e, k]
