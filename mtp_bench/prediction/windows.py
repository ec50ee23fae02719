"""Windows of tracks: the input of a learned predictor, in training and in agents.

Networks see a window in the heading frame of its last box.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..agent import Frame
from ..core import (
    UNBORN,
    Bools,
    Floats,
    Ints,
    Observation,
    Ragged,
    Tracks,
    rotate,
    rotation,
    select,
    starts_of,
    wrap_angle,
)
from .learned.layers import Array, Inputs, namespace

Arrays = dict[str, np.ndarray]

PER_FRAME = 10  # features of `history` for each frame
_MIN_SPREAD_S2 = 1e-6  # of the times of several boxes

# fields of observations that show lanes
LANE_FIELDS = ("lane_point", "lane_valid", "lane_next")


@dataclass(frozen=True, eq=False)
class Surroundings(Ragged):
    """Detections and lanes of m frames, in the frame of the observations.

    Frames of a scene stand one after another.
    """

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, 0 where it is not measured
    class_id: Ints  # [R]
    score: Floats  # [R]
    # [m] frames of the same scene that stand before each frame, without a hole in time
    before: Ints
    # `LANE_FIELDS` [m, L, ...] as observed; empty: none shown
    lanes: dict[str, NDArray[Any]] = field(default_factory=dict)

    def lanes_at(self, moment: int) -> Observation:
        """Return the lanes of a frame, as its observation showed them.

        Empty if it showed none.
        """
        return {name: values[moment] for name, values in self.lanes.items()}


def surroundings_of(observations: Sequence[Observation]) -> Surroundings:
    """Return detections and lanes of these frames, of one scene."""
    rows = [np.flatnonzero(np.asarray(o["detection_valid"])) for o in observations]

    def column(name: str) -> NDArray[Any]:
        parts = [
            np.asarray(observation[f"detection_{name}"])[kept_rows]
            for observation, kept_rows in zip(observations, rows, strict=True)
        ]
        return np.concatenate(parts)

    return Surroundings(
        start=starts_of([len(frame_rows) for frame_rows in rows]),
        box=column("box"),
        velocity=column("velocity"),
        class_id=column("class"),
        score=column("score"),
        before=np.arange(len(observations)),
        lanes=lanes_of(observations),
    )


def lanes_of(observations: Sequence[Observation]) -> dict[str, NDArray[Any]]:
    """Return lanes [m, L, ...] of observations by field.

    Empty if they show none.
    """
    return {
        name: np.stack([observation[name] for observation in observations])
        for name in LANE_FIELDS
        if name in observations[0]
    }


@dataclass(frozen=True, eq=False)
class TrackWindows:
    """The last P frames of n tracks, in the frame of the observations.

    The last row is now.
    """

    # [n, P, 7] the detection taken, else where the tracker expects it; 0 before birth
    box: Floats
    taken: Bools  # [n, P] a detection was taken; alive and not taken: the track coasts
    alive: Bools  # [n, P] the track is born
    # [n, P] its row in the observation of that frame; -1: none, or it is not stated
    detection: Ints
    score: Floats  # [n, P] of the detection taken, else 0
    # [n, P, 2] m/s that the detector measured with the detection taken, else 0
    velocity: Floats
    class_id: Ints  # [n]
    hits: Ints  # [n] detections taken since birth
    age: Ints  # [n] frames since birth, this one included
    mass: Floats  # [n] total weight of the hypotheses that hold the track
    best: Bools  # [n] the heaviest hypothesis holds it
    # [n, P, 4] x y z yaw of the platform; before the scene as in its first frame
    ego: Floats

    def __len__(self) -> int:
        return len(self.class_id)

    def select(self, rows: Ints | Bools | slice) -> Self:
        """Return the windows ``rows``."""
        return select(self, rows)


def shown_as_truth(windows: TrackWindows) -> TrackWindows:
    """Return windows in the form of ground-truth tracks.

    Every box has score 1; hits and age are those within the window.
    """
    return replace(
        windows,
        score=windows.taken.astype(np.float64),
        hits=np.maximum(windows.taken.sum(axis=1), 1),
        age=np.maximum(windows.alive.sum(axis=1), 1),
    )


def windows_of(frame: Frame, past: int) -> tuple[TrackWindows, Ints]:
    """Return the distinct windows of a frame's tracks, and each track's.

    The second result [N] is the row of each track's window. ``past``: frames of a
    window. Tracks that took the same detections in these frames share the window of the
    first of them, whatever came before. A tracker that does not state the detections it
    took has a window for each track.

    If tracks of one window coast, or differ in age, this is not exact. At the simulated
    intersection with 20 hypotheses 2 % of the objects have forecasts from another
    track's window, half of them more than 0.4 m off.
    """
    tracks = _with_past(frame.tracks, past)
    first, window = _distinct(tracks)
    taken = tracks.past_valid[first]
    if tracks.past_detection is None:
        alive = np.maximum.accumulate(taken, axis=1)
        detection = np.full(taken.shape, -1)
        score = np.where(taken, tracks.score[first][:, None], 0.0)
        velocity = np.zeros((*taken.shape, 2))
    else:
        row = tracks.past_detection[first]
        alive = row != UNBORN
        detection = np.maximum(row, -1)
        score, velocity = _measured(row, frame.seen)
    hits = np.maximum(taken.sum(axis=1), 1)
    if tracks.hits is not None:
        hits = tracks.hits[first]
    age = np.maximum(alive.sum(axis=1), 1)
    if tracks.age is not None:
        age = tracks.age[first]
    mass = np.exp(tracks.log_weight) @ tracks.member
    count = len(first)
    windows = TrackWindows(
        box=tracks.past[first],
        taken=taken,
        alive=alive,
        detection=detection,
        score=score,
        velocity=velocity,
        class_id=tracks.class_id[first],
        hits=hits,
        age=age,
        mass=np.bincount(window, mass, minlength=count).astype(np.float64),
        best=np.bincount(window, tracks.member[0], minlength=count) > 0,
        ego=np.broadcast_to(_ego_poses(frame.seen, past), (count, past, 4)),
    )
    return windows, window


def _with_past(tracks: Tracks, past: int) -> Tracks:
    """Return the tracks with pasts of exactly ``past`` frames.

    They are unborn in frames that the tracker does not keep.
    """
    padding = (max(past - tracks.past.shape[1], 0), 0)
    detection = tracks.past_detection
    if detection is not None:
        detection = np.pad(detection, ((0, 0), padding), constant_values=UNBORN)
        detection = detection[:, -past:]
    box = np.pad(tracks.past, ((0, 0), padding, (0, 0)))[:, -past:]
    valid = np.pad(tracks.past_valid, ((0, 0), padding))[:, -past:]
    return replace(tracks, past=box, past_valid=valid, past_detection=detection)


def _distinct(tracks: Tracks) -> tuple[Ints, Ints]:
    """Return the first track [n] of each window, and each track's window [N].

    Windows and tracks are numbers.
    """
    count = len(tracks.box)
    if tracks.past_detection is None or count == 0:
        return np.arange(count), np.arange(count)
    # without a detection only the identity distinguishes tracks
    without_detection = (tracks.past_detection < 0).all(axis=1)
    identity = np.where(without_detection, tracks.track_id, -1)
    columns = [tracks.class_id[:, None], tracks.past_detection, identity[:, None]]
    key = np.concatenate(columns, axis=1)
    _, first, window = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return first, window.reshape(-1)


def _measured(row: Ints, observations: Sequence[Observation]) -> tuple[Floats, Floats]:
    """Return scores [n, P] and velocities [n, P, 2] of the detections taken.

    ``row`` [n, P]: their rows, below 0 for none.
    """
    score = np.zeros(row.shape)
    velocity = np.zeros((*row.shape, 2))
    recent = observations[-row.shape[1] :]
    for column, observation in zip(range(-len(recent), 0), recent, strict=True):
        window = np.flatnonzero(row[:, column] >= 0)
        taken = row[window, column]
        score[window, column] = np.asarray(observation["detection_score"])[taken]
        velocity[window, column] = np.asarray(observation["detection_velocity"])[taken]
    return score, velocity


def _ego_poses(observations: Sequence[Observation], past: int) -> Floats:
    """Return poses [P, 4] of the platform, zeros without them.

    Frames before the scene have the first pose.
    """
    no_pose = np.zeros(4)
    recent = observations[-past:]
    poses = np.array([o.get("ego_pose", no_pose) for o in recent], dtype=np.float64)
    return np.concatenate([np.repeat(poses[:1], past - len(poses), axis=0), poses])


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
    was_alive = xp.concatenate([xp.zeros_like(alive[:, :1]), alive[:, :-1]], 1)
    columns = [
        position,
        step * was_alive[:, :, None],
        inputs["velocity"],
        xp.sin(yaw)[:, :, None],
        xp.cos(yaw)[:, :, None] - 1,
        inputs["score"][:, :, None],
    ]
    numbers = xp.concatenate(columns, 2) * alive[:, :, None]
    return xp.concatenate([numbers, inputs["taken"][:, :, None]], 2)


def mean_velocity(inputs: Inputs, dt: float) -> Array:
    """Return velocities [n, 2] m/s: slopes of least-squares lines through the past.

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
    slope = moment / xp.clip(spread, _MIN_SPREAD_S2, None)[:, None]
    has_several = (spread > _MIN_SPREAD_S2)[:, None]
    return xp.where(has_several, slope, inputs["velocity"][:, -1])


def one_hot(class_id: Array, classes: int, like: Array) -> Array:
    """Return one-hot classes [n, C], in the precision of ``like``."""
    xp = namespace(like)
    if xp is np:
        numbers = xp.arange(classes)
    else:
        numbers = xp.arange(classes, device=class_id.device)
    return (class_id[:, None] == numbers[None]) + xp.zeros_like(like[:, :1])
