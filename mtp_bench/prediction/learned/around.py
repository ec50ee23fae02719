"""Detections around the present boxes of objects in the last frames.

They are the input of networks that do not trust tracks. Of a window only the last box
and the class are used: the rest of the track does not change the output.
"""

import numpy as np

from ...core import Floats, Ints, in_groups, rotation, starts_of, wrap_angle
from ..windows import Arrays, Surroundings, TrackWindows, single_precision
from .layers import Array, namespace
from .network import Sizes

NEAREST = 6  # M: detections of a frame that are kept, at most
# m along the heading and across it, in which a detection of this frame is near
REACH = np.array([2.0, 2.0])
# m/s by which the reach grows with age, since the object was elsewhere then
SPEED = np.array([20.0, 4.0])
OTHER_CLASS = 2.0  # factor of the distance of a detection of another class
FINE = 0.3  # m: offsets are linear up to here, logarithmic beyond
# scales of inputs
SIZE_SCALE = 5  # m
VELOCITY_SCALE = 10  # m/s
PRIOR_WEIGHT = 0.01  # of the prior of a velocity, beside one position a frame away


def around_inputs(
    windows: TrackWindows, moment: Ints, surroundings: Surroundings, sizes: Sizes
) -> Arrays:
    """Return the M nearest detections of each past frame, float32.

    There are P frames. Positions are in the heading frame of the last box. ``moment``
    [n]: the frame of each window in ``surroundings``. Frames stand oldest first,
    detections nearest first. The arrays of a detection are 0 where none exists:

    - near [n, P, M]: 1 if the detection exists
    - position [n, P, M, 2] m, velocity [n, P, M, 2] m/s as measured, yaw [n, P, M] rad
    - score [n, P, M]; same [n, P, M]: 1 if it has the class of the object
    - ratio [n, P, M, 2]: logarithm of its length and width over those of the object

    Beside these there are size [n, 3] m and class_id [n] of the object.
    """
    frames_ago = range(sizes.past - 1, -1, -1)
    rows = [nearest(windows, moment, surroundings, i, i * sizes.dt) for i in frames_ago]
    row = np.stack(rows, axis=1)
    near = row >= 0
    turn = rotation(windows.box[:, -1, 3])
    box = _rows_of(surroundings.box, row)
    velocity = _rows_of(surroundings.velocity, row)
    class_id = _rows_of(surroundings.class_id, row)
    last_box = windows.box[:, None, None, -1]
    offset = np.einsum("npmi,nij->npmj", box[..., :2] - last_box[..., :2], turn)
    size = np.maximum(box[..., 4:6], 0.1)
    ratio = np.log(size / np.maximum(last_box[..., 4:6], 0.1))
    arrays = {
        "near": near,
        "position": offset * near[..., None],
        "velocity": np.einsum("npmi,nij->npmj", velocity, turn),
        "yaw": wrap_angle(box[..., 3] - last_box[..., 3]) * near,
        "score": _rows_of(surroundings.score, row),
        "same": near & (class_id == windows.class_id[:, None, None]),
        "ratio": ratio * near[..., None],
        "size": windows.box[:, -1, 4:],
    }
    return single_precision(arrays, windows.class_id)


def nearest(
    windows: TrackWindows,
    moment: Ints,
    surroundings: Surroundings,
    frames_ago: int,
    age: float,
) -> Ints:
    """Return rows [n, M] in ``surroundings`` of the detections within reach.

    The row is -1 where no more are. The detections are from ``frames_ago`` frames,
    ``age`` s, before ``moment``. The nearest come first, by `_distance`.
    """
    frame = np.maximum(moment - frames_ago, 0)
    count = np.where(
        surroundings.before[moment] >= frames_ago, surroundings.counts[frame], 0
    )
    # all pairs of a window (owner) with a detection (row) of its frame
    owner, place = in_groups(count)
    row = surroundings.start[frame][owner] + place
    distance = _distance(windows, surroundings, owner, row, age)
    reached = np.flatnonzero(distance <= 1)
    reached = reached[np.lexsort((distance[reached], owner[reached]))]
    owner = owner[reached]
    row = row[reached]
    rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
    is_among = rank < NEAREST
    nearest_row = np.full((len(windows), NEAREST), -1)
    nearest_row[owner[is_among], rank[is_among]] = row[is_among]
    return nearest_row


def detections_of_tracks(
    windows: TrackWindows, moment: Ints, surroundings: Surroundings
) -> tuple[Surroundings, Ints]:
    """Return the detections that tracks took, as scenes.

    Beside them the last frame of each scene. Each track stands by itself in a scene of
    its P frames. So the input of a network is what the tracker associated with the
    object, without the other detections around.
    """
    frames = windows.detection.shape[1]
    age = np.arange(frames)[::-1]
    has_row = (windows.detection >= 0) & (age <= surroundings.before[moment][:, None])
    first_row = surroundings.start[np.maximum(moment[:, None] - age, 0)]
    row = (first_row + windows.detection)[has_row]
    scenes = Surroundings(
        starts_of(has_row.ravel().astype(np.int64)),
        surroundings.box[row],
        surroundings.velocity[row],
        surroundings.class_id[row],
        surroundings.score[row],
        np.tile(age[::-1], len(windows)),
    )
    return scenes, np.arange(1, len(windows) + 1) * frames - 1


def _distance(
    windows: TrackWindows,
    surroundings: Surroundings,
    owner: Ints,
    row: Ints,
    age: float,
) -> Floats:
    """Return distances [r] of detections from the last boxes of windows.

    ``owner`` [r]: the windows; ``row`` [r]: the detections. The distance is 1 at the
    end of the reach after ``age`` s.
    """
    turn = rotation(windows.box[:, -1, 3]) / (REACH + SPEED * age)
    offset = surroundings.box[row, :2] - windows.box[owner, -1, :2]
    distance = np.hypot(*np.einsum("ri,rij->jr", offset, turn[owner]))
    is_same = surroundings.class_id[row] == windows.class_id[owner]
    return np.asarray(distance * np.where(is_same, 1.0, OTHER_CLASS))


def _rows_of(values: np.ndarray, row: Ints) -> np.ndarray:
    """Return the rows of ``values`` [R, ...], 0 for row -1."""
    # index -1 picks the appended zeros
    no_row = np.zeros_like(values[:1], shape=(1, *values.shape[1:]))
    return np.concatenate([values, no_row])[row]


def ages(near: Array, dt: float) -> Array:
    """Return the age [n, P, M] s of detections and empty places."""
    xp = namespace(near)
    # in the precision of the weights
    return (near.shape[1] - xp.cumsum(xp.ones_like(near), 1)) * dt


def shares(logit: Array, near: Array) -> Array:
    """Return the softmax of ``logit`` [n, M, ...] over the ``near`` detections.

    "None" takes part, with the logit 0, so that the sum is below 1.
    """
    xp = namespace(logit)
    highest = xp.clip(xp.amax(logit * near, 1), 0, None)
    weight = xp.exp(xp.clip(logit - highest[:, None], -50, 0)) * near
    return weight / (xp.exp(-highest) + weight.sum(1))[:, None]


def fitted_velocity(
    age: Array, position: Array, weight: Array, prior: Array, dt: float
) -> Array:
    """Fit straight lines through the origin now.

    Returns their slopes, velocities [n, 2] m/s. Each object has S positions: ``age``
    [n, S] s, ``position`` [n, S, 2] m, ``weight`` [n, S]. ``prior`` [n, 2] m/s is the
    velocity of an object without positions.
    """
    # least squares over the time -age
    total = 1 + weight.sum(1)  # the origin has the weight 1
    middle = (weight * age).sum(1) / total
    lever = (middle[:, None] - age) * weight
    spread = (lever * (middle[:, None] - age)).sum(1) + middle**2 + PRIOR_WEIGHT * dt**2
    slope = (lever[:, :, None] * position).sum(1) + PRIOR_WEIGHT * dt**2 * prior
    return slope / spread[:, None]
