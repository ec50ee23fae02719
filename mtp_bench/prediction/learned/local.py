"""Windows in the heading frame of their last box, the frame of networks, and back."""

import numpy as np

from ...core import Floats, rotate, wrap_angle
from ..kalman import rotation
from ..windows import TrackWindows
from .layers import Array, Inputs, namespace

Arrays = dict[str, np.ndarray]

PER_FRAME = 10  # features of `history` for each frame


def single_precision(arrays: Arrays, class_id: np.ndarray) -> Arrays:
    """Return ``arrays`` as float32, and ``class_id`` as it is."""
    single = {name: value.astype(np.float32) for name, value in arrays.items()}
    return {**single, "class_id": class_id}


def local_inputs(windows: TrackWindows) -> Arrays:
    """Return features of n windows, float32.

    The origin is the centre of the last box, x points along its yaw. position
    [n, P, 2] m · yaw [n, P] rad · velocity [n, P, 2] m/s as measured · score, taken,
    alive [n, P] · size [n, 3] m · counts [n, 2] log of hits and age · class_id [n].
    """
    turn = rotation(windows.box[:, -1, 3])
    offset = windows.box[:, :, :2] - windows.box[:, -1:, :2]
    arrays = {
        "position": np.einsum("npi,nij->npj", offset, turn),
        "yaw": wrap_angle(windows.box[:, :, 3] - windows.box[:, -1:, 3]),
        "velocity": np.einsum("npi,nij->npj", windows.velocity, turn),
        "score": windows.score,
        "taken": windows.taken,
        "alive": windows.alive,
        "size": windows.box[:, -1, 4:],
        "counts": np.log(np.stack([windows.hits, windows.age], axis=-1)),
    }
    return single_precision(arrays, windows.class_id)


def local_future(windows: TrackWindows, xy: Floats) -> Floats:
    """Return positions [n, T, 2] in heading frames of windows, float32."""
    offset = xy - windows.box[:, -1:, :2]
    turn = rotation(windows.box[:, -1, 3])
    return np.asarray(np.einsum("nti,nij->ntj", offset, turn), dtype=np.float32)


def to_absolute(windows: TrackWindows, xy: Floats) -> Floats:
    """Return positions [n, ..., 2] in heading frames as absolute x y."""
    last_box = windows.box[:, -1].reshape(len(xy), *(1,) * (xy.ndim - 2), 7)
    return rotate(xy, last_box[..., 3]) + last_box[..., :2]


def history(inputs: Inputs) -> Array:
    """Return features [n, P, PER_FRAME] of the past.

    They are 0 before the track was born. Columns: position x y, step x y from the frame
    before, velocity x y, sin of yaw, cos of yaw less 1, score, taken.
    """
    position = inputs["position"]
    xp = namespace(position)
    alive = inputs["alive"]
    yaw = inputs["yaw"]
    step = position[:, 1:] - position[:, :-1]
    step = xp.concatenate([xp.zeros_like(position[:, :1]), step], 1)
    # a first box has no step
    born = xp.concatenate([xp.zeros_like(alive[:, :1]), alive[:, :-1]], 1)
    columns = [
        position,
        step * born[:, :, None],
        inputs["velocity"],
        xp.sin(yaw)[:, :, None],
        xp.cos(yaw)[:, :, None] - 1,
        inputs["score"][:, :, None],
    ]
    numbers = xp.concatenate(columns, 2) * alive[:, :, None]
    return xp.concatenate([numbers, inputs["taken"][:, :, None]], 2)


def mean_velocity(inputs: Inputs, dt: float) -> Array:
    """Return velocities [n, 2] m/s: slopes of straight lines through the past.

    That of a single box is the measured velocity. ``dt``: s between frames.
    """
    xp = namespace(inputs["position"])
    alive = inputs["alive"]
    # in the precision of the weights
    time = (xp.cumsum(xp.ones_like(alive), 1) - alive.shape[1]) * dt
    count = xp.clip(alive.sum(1), 1, None)
    center = time - ((time * alive).sum(1) / count)[:, None]
    spread = (center * center * alive).sum(1)
    moment = ((center * alive)[:, :, None] * inputs["position"]).sum(1)
    slope = moment / xp.clip(spread, 1e-6, None)[:, None]
    has_several = (spread > 1e-6)[:, None]
    return xp.where(has_several, slope, inputs["velocity"][:, -1])


def one_hot(class_id: Array, classes: int, like: Array) -> Array:
    """Return one-hot classes [n, C], in the precision of ``like``."""
    xp = namespace(like)
    if xp is np:
        numbers = xp.arange(classes)
    else:
        numbers = xp.arange(classes, device=class_id.device)
    return (class_id[:, None] == numbers[None]) + xp.zeros_like(like[:, :1])
