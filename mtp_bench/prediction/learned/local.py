"""Windows in the heading frame of their last box, the frame of networks, and back."""

import numpy as np

from ...core import Floats, rotate, wrap_angle
from ..kalman import rotation
from ..windows import TrackWindows
from .layers import Array, namespace

Arrays = dict[str, np.ndarray]

PER_FRAME = 10  # features of `history` for each frame


def local_inputs(windows: TrackWindows) -> Arrays:
    """Features of n windows, float32; the origin is the centre of the last box, x points along its yaw.

    position [n, P, 2] m · yaw [n, P] rad · velocity [n, P, 2] m/s as measured · score, taken, alive [n, P] · size
    [n, 3] m · counts [n, 2] log of hits and age · class_id [n].
    """
    turn = rotation(windows.box[:, -1, 3])
    inputs = {
        "position": np.einsum(
            "npi,nij->npj", windows.box[:, :, :2] - windows.box[:, -1:, :2], turn
        ),
        "yaw": wrap_angle(windows.box[:, :, 3] - windows.box[:, -1:, 3]),
        "velocity": np.einsum("npi,nij->npj", windows.velocity, turn),
        "score": windows.score,
        "taken": windows.taken,
        "alive": windows.alive,
        "size": windows.box[:, -1, 4:],
        "counts": np.log(np.stack([windows.hits, windows.age], axis=-1)),
    }
    return {
        **{name: value.astype(np.float32) for name, value in inputs.items()},
        "class_id": windows.class_id,
    }


def local_future(windows: TrackWindows, xy: Floats) -> Floats:
    """Positions [n, T, 2] in the heading frame of each window, float32."""
    offset = xy - windows.box[:, -1:, :2]
    return np.asarray(
        np.einsum("nti,nij->ntj", offset, rotation(windows.box[:, -1, 3])),
        dtype=np.float32,
    )


def to_absolute(windows: TrackWindows, xy: Floats) -> Floats:
    """Absolute x y of positions [n, ..., 2] in the heading frame of each window."""
    now = windows.box[:, -1].reshape(len(xy), *(1,) * (xy.ndim - 2), 7)
    return rotate(xy, now[..., 3]) + now[..., :2]


def history(inputs: dict[str, Array]) -> Array:
    """Features [n, P, PER_FRAME] of the past, 0 in frames before the track was born.

    Columns: position x y, step x y from the frame before, velocity x y, sin of yaw, cos of yaw less 1, score, taken.
    """
    xp, alive = namespace(inputs["position"]), inputs["alive"]
    position, yaw = inputs["position"], inputs["yaw"]
    step = xp.concatenate(
        [xp.zeros_like(position[:, :1]), position[:, 1:] - position[:, :-1]], 1
    )
    born = xp.concatenate(
        [xp.zeros_like(alive[:, :1]), alive[:, :-1]], 1
    )  # a first box has no step
    columns = [position, step * born[:, :, None], inputs["velocity"]]
    columns += [
        xp.sin(yaw)[:, :, None],
        xp.cos(yaw)[:, :, None] - 1,
        inputs["score"][:, :, None],
    ]
    numbers = xp.concatenate(columns, 2) * alive[:, :, None]
    return xp.concatenate([numbers, inputs["taken"][:, :, None]], 2)


def mean_velocity(inputs: dict[str, Array], dt: float) -> Array:
    """Velocities [n, 2] m/s: slope of a straight line through the past; of a single box the measured velocity."""
    xp, alive = namespace(inputs["position"]), inputs["alive"]
    frames = alive.shape[1]
    time = (
        xp.cumsum(xp.ones_like(alive), 1) - frames
    ) * dt  # in the precision of the weights
    count = xp.clip(alive.sum(1), 1, None)
    center = time - ((time * alive).sum(1) / count)[:, None]
    spread = (center * center * alive).sum(1)
    slope = ((center * alive)[:, :, None] * inputs["position"]).sum(1) / xp.clip(
        spread, 1e-6, None
    )[:, None]
    several = (spread > 1e-6)[:, None]
    return xp.where(several, slope, inputs["velocity"][:, -1])


def one_hot(class_id: Array, classes: int, like: Array) -> Array:
    """One-hot classes [n, C], in the precision of ``like``."""
    xp = namespace(like)
    known = (
        xp.arange(classes) if xp is np else xp.arange(classes, device=class_id.device)
    )
    return (class_id[:, None] == known[None]) + xp.zeros_like(like[:, :1])
