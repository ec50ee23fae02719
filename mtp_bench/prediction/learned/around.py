"""Detections around the present boxes of objects in the last frames: input of networks that do not trust tracks.

Of a window only the last box and the class are used: the rest of the track does not change the output.
"""

import numpy as np

from ...core import Floats, Ints, starts_of, wrap_angle
from ..kalman import rotation
from ..windows import Surroundings, TrackWindows
from .layers import Array, namespace
from .local import Arrays
from .network import Sizes

NEAREST = 6  # M: detections of a frame that are kept, at most
REACH = np.array(
    [2.0, 2.0]
)  # m along the heading and across it, in which a detection of this frame is near
SPEED = np.array(
    [20.0, 4.0]
)  # m/s by which the reach grows with age, since the object was elsewhere then
OTHER_CLASS = 2.0  # factor of the distance of a detection of another class
FINE = 0.3  # m: offsets are linear up to here, logarithmic beyond
PRIOR_WEIGHT = 0.01  # of the prior of a velocity, beside one position a frame away


def around_inputs(
    windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes
) -> Arrays:
    """The M nearest detections of each of the last P frames, float32, in the heading frame of the last box.

    ``moment`` [n]: the frame of each window in ``seen``. Frames stand oldest first, detections nearest first.
    near [n, P, M] 1 if it exists, else all is 0 · position [n, P, M, 2] m · velocity [n, P, M, 2] m/s as measured · yaw
    [n, P, M] rad · score, same (class) [n, P, M] · ratio [n, P, M, 2] log of its length and width over the object's ·
    size [n, 3] m · class_id [n].
    """
    backs = range(sizes.past - 1, -1, -1)
    row = np.stack(
        [nearest(windows, moment, seen, back, back * sizes.dt) for back in backs],
        axis=1,
    )
    near = row >= 0
    turn = rotation(windows.box[:, -1, 3])
    box, velocity = (_rows_of(values, row) for values in (seen.box, seen.velocity))
    now = windows.box[:, None, None, -1]
    inputs = {
        "near": near,
        "position": np.einsum("npmi,nij->npmj", box[..., :2] - now[..., :2], turn)
        * near[..., None],
        "velocity": np.einsum("npmi,nij->npmj", velocity, turn),
        "yaw": wrap_angle(box[..., 3] - now[..., 3]) * near,
        "score": _rows_of(seen.score, row),
        "same": near
        & (_rows_of(seen.class_id, row) == windows.class_id[:, None, None]),
        "ratio": np.log(np.maximum(box[..., 4:6], 0.1) / np.maximum(now[..., 4:6], 0.1))
        * near[..., None],
        "size": windows.box[:, -1, 4:],
    }
    return {
        **{name: value.astype(np.float32) for name, value in inputs.items()},
        "class_id": windows.class_id,
    }


def nearest(
    windows: TrackWindows, moment: Ints, seen: Surroundings, back: int, age: float
) -> Ints:
    """Rows [n, M] in ``seen`` of the detections within reach ``back`` frames, ``age`` s, ago; -1: no more.

    The nearest come first, as the reach measures distance.
    """
    then = np.maximum(moment - back, 0)
    count = np.where(seen.before[moment] >= back, seen.counts[then], 0)
    owner = np.repeat(np.arange(len(windows)), count)
    row = np.arange(len(owner)) + np.repeat(
        seen.start[then] - np.cumsum(count) + count, count
    )
    far = _distance(windows, seen, owner, row, age)
    kept = np.flatnonzero(far <= 1)
    kept = kept[np.lexsort((far[kept], owner[kept]))]
    owner, row = owner[kept], row[kept]
    place = np.arange(len(owner)) - np.searchsorted(owner, owner)
    found = np.full((len(windows), NEAREST), -1)
    among = place < NEAREST
    found[owner[among], place[among]] = row[among]
    return found


def detections_of_tracks(
    windows: TrackWindows, moment: Ints, seen: Surroundings
) -> tuple[Surroundings, Ints]:
    """The detections that tracks took, each track alone in a scene of its P frames, and the last frame of each scene.

    So the input of a network is what the tracker associated with the object, without the other detections around.
    """
    back = np.arange(windows.detection.shape[1])[::-1]
    there = (windows.detection >= 0) & (back <= seen.before[moment][:, None])
    row = (seen.start[np.maximum(moment[:, None] - back, 0)] + windows.detection)[there]
    start, before = (
        starts_of(there.ravel().astype(np.int64)),
        np.tile(back[::-1], len(windows)),
    )
    alone = Surroundings(
        start,
        seen.box[row],
        seen.velocity[row],
        seen.class_id[row],
        seen.score[row],
        before,
    )
    return alone, np.arange(1, len(windows) + 1) * len(back) - 1


def _distance(
    windows: TrackWindows, seen: Surroundings, owner: Ints, row: Ints, age: float
) -> Floats:
    """Distances [r] of detections from the last boxes of the windows ``owner``; 1: at the end of the reach."""
    turn = rotation(windows.box[:, -1, 3]) / (REACH + SPEED * age)
    offset = seen.box[row, :2] - windows.box[owner, -1, :2]
    far = np.hypot(*np.einsum("ri,rij->jr", offset, turn[owner]))
    return np.asarray(
        far * np.where(seen.class_id[row] == windows.class_id[owner], 1.0, OTHER_CLASS)
    )


def _rows_of(values: np.ndarray, row: Ints) -> np.ndarray:
    """``values`` [R, ...] of the rows, 0 for row -1."""
    return np.concatenate(
        [values, np.zeros_like(values[:1], shape=(1, *values.shape[1:]))]
    )[row]


def ages(near: Array, dt: float) -> Array:
    """Age [n, P, M] s of the detections ``near`` [n, P, M], and of empty places."""
    xp, frames = namespace(near), near.shape[1]
    return (
        frames - xp.cumsum(xp.ones_like(near), 1)
    ) * dt  # in the precision of the weights


def shares(logit: Array, near: Array) -> Array:
    """Softmax of ``logit`` [n, M, ...] over the detections that are ``near``, and over "none", whose logit is 0."""
    xp = namespace(logit)
    highest = xp.clip(xp.amax(logit * near, 1), 0, None)
    weight = xp.exp(xp.clip(logit - highest[:, None], -50, 0)) * near
    return weight / (xp.exp(-highest) + weight.sum(1))[:, None]


def fitted_velocity(
    age: Array, position: Array, weight: Array, prior: Array, dt: float
) -> Array:
    """Velocities [n, 2] m/s: slope of a straight line through weighted positions and the origin now.

    ``age`` [n, S] s, ``position`` [n, S, 2] m, ``weight`` [n, S]; ``prior`` [n, 2] m/s, for objects without positions.
    """
    total = 1 + weight.sum(1)  # the origin has the weight 1
    middle = (weight * age).sum(1) / total
    lever = (middle[:, None] - age) * weight
    spread = (lever * (middle[:, None] - age)).sum(1) + middle**2 + PRIOR_WEIGHT * dt**2
    slope = (lever[:, :, None] * position).sum(1) + PRIOR_WEIGHT * dt**2 * prior
    return slope / spread[:, None]
