"""Windows of tracks: the input of a learned predictor, the same in training and in an agent."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..agent import Frame
from ..core import UNBORN, Bools, Floats, Ints, Observation, Ragged, Tracks, starts_of

LANES = (
    "lane_point",
    "lane_valid",
    "lane_next",
)  # fields of observations that show lanes


@dataclass(frozen=True, eq=False)
class Surroundings(Ragged):
    """Detections and lanes of m frames, in the frame of the observations; frames of a scene stand one after another."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, 0 where it is not measured
    class_id: Ints  # [R]
    score: Floats  # [R]
    before: Ints  # [m] frames of the same scene that stand before each frame, without a hole in time
    lanes: dict[str, NDArray[Any]] = field(
        default_factory=dict
    )  # `LANES` [m, L, ...] as observed; empty: none shown

    def lanes_at(self, moment: int) -> Observation:
        """The lanes of a frame, as its observation showed them; empty if it showed none."""
        return {name: values[moment] for name, values in self.lanes.items()}


def surroundings_of(seen: Sequence[Observation]) -> Surroundings:
    """Detections and lanes of these frames, of one scene."""
    valid = [
        np.flatnonzero(np.asarray(observation["detection_valid"]))
        for observation in seen
    ]
    box, velocity, class_id, score = (
        np.concatenate(
            [
                np.asarray(o[f"detection_{name}"])[rows]
                for o, rows in zip(seen, valid, strict=True)
            ]
        )
        for name in ("box", "velocity", "class", "score")
    )
    start = starts_of([len(rows) for rows in valid])
    return Surroundings(
        start, box, velocity, class_id, score, np.arange(len(seen)), lanes_of(seen)
    )


def lanes_of(seen: Sequence[Observation]) -> dict[str, NDArray[Any]]:
    """Lanes [m, L, ...] of observations by field; empty if they show none."""
    return {
        name: np.stack([observation[name] for observation in seen])
        for name in LANES
        if name in seen[0]
    }


@dataclass(frozen=True, eq=False)
class TrackWindows:
    """The last P frames of n tracks, in the frame of the observations; the last row is now."""

    box: Floats  # [n, P, 7] the detection taken, else where the tracker expects it; 0 before birth
    taken: Bools  # [n, P] a detection was taken; alive and not taken: the track coasts
    alive: Bools  # [n, P] the track is born
    detection: Ints  # [n, P] its row in the observation of that frame; -1: none, or the tracker does not state it
    score: Floats  # [n, P] of the detection taken, else 0
    velocity: Floats  # [n, P, 2] m/s that the detector measured with the detection taken, else 0
    class_id: Ints  # [n]
    hits: Ints  # [n] detections taken since birth
    age: Ints  # [n] frames since birth, this one included
    mass: Floats  # [n] total weight of the hypotheses that hold the track
    best: Bools  # [n] the heaviest hypothesis holds it
    ego: Floats  # [n, P, 4] x y z yaw of the platform; before the scene as in its first frame

    def __len__(self) -> int:
        return len(self.class_id)

    def select(self, rows: Ints | Bools | slice) -> Self:
        """The windows ``rows``."""
        return replace(
            self, **{f.name: getattr(self, f.name)[rows] for f in fields(TrackWindows)}
        )


def shown_as_truth(windows: TrackWindows) -> TrackWindows:
    """Windows in the form of ground-truth tracks: score 1 for every box, hits and age within the window alone."""
    hits, age = (
        np.maximum(mask.sum(axis=1), 1) for mask in (windows.taken, windows.alive)
    )
    return replace(windows, score=windows.taken.astype(np.float64), hits=hits, age=age)


def windows_of(frame: Frame, past: int) -> tuple[TrackWindows, Ints]:
    """The distinct windows of ``past`` frames of a frame's tracks, and the window [N] of each track.

    Tracks that took the same detections in these frames share the window of the first of them, whatever came before.
    If such tracks coast, or differ in age, this is not exact: at the simulated intersection with 20 hypotheses the
    forecasts of 2 % of the objects are of another track's window, half of them by more than 0.4 m. A tracker that does
    not state the detections it took has a window for each track.
    """
    tracks = _with_past(frame.tracks, past)
    first, window = _distinct(tracks)
    taken = tracks.past_valid[first]
    row = (
        np.where(taken, 0, -1)
        if tracks.past_detection is None
        else tracks.past_detection[first]
    )
    alive = (
        np.maximum.accumulate(taken, axis=1)
        if tracks.past_detection is None
        else row != UNBORN
    )
    score, velocity = _measured(tracks, first, row, frame.seen)
    mass = np.exp(tracks.log_weight) @ tracks.member
    windows = TrackWindows(
        box=tracks.past[first],
        taken=taken,
        detection=np.full(taken.shape, -1)
        if tracks.past_detection is None
        else np.maximum(row, -1),
        alive=alive,
        score=score,
        velocity=velocity,
        class_id=tracks.class_id[first],
        hits=np.maximum(taken.sum(axis=1), 1)
        if tracks.hits is None
        else tracks.hits[first],
        age=np.maximum(alive.sum(axis=1), 1)
        if tracks.age is None
        else tracks.age[first],
        mass=np.bincount(window, mass, minlength=len(first)).astype(np.float64),
        best=np.bincount(window, tracks.member[0], minlength=len(first)) > 0,
        ego=np.broadcast_to(_ego(frame.seen, past), (len(first), past, 4)),
    )
    return windows, window


def _with_past(tracks: Tracks, past: int) -> Tracks:
    """The tracks with pasts of exactly ``past`` frames, unborn in frames that the tracker does not keep."""
    more = max(past - tracks.past.shape[1], 0)
    detection = tracks.past_detection
    if detection is not None:
        detection = np.pad(detection, ((0, 0), (more, 0)), constant_values=UNBORN)[
            :, -past:
        ]
    box = np.pad(tracks.past, ((0, 0), (more, 0), (0, 0)))[:, -past:]
    valid = np.pad(tracks.past_valid, ((0, 0), (more, 0)))[:, -past:]
    return replace(tracks, past=box, past_valid=valid, past_detection=detection)


def _distinct(tracks: Tracks) -> tuple[Ints, Ints]:
    """The first track of each window and the window [N] of each track."""
    n = len(tracks.box)
    if tracks.past_detection is None or n == 0:
        return np.arange(n), np.arange(n)
    key = np.concatenate([tracks.class_id[:, None], tracks.past_detection], axis=1)
    unseen = (tracks.past_detection < 0).all(
        axis=1
    )  # then only the identity distinguishes tracks
    key = np.concatenate([key, np.where(unseen, tracks.track_id, -1)[:, None]], axis=1)
    _, first, window = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return first, window.reshape(-1)


def _measured(
    tracks: Tracks, first: Ints, row: Ints, seen: Sequence[Observation]
) -> tuple[Floats, Floats]:
    """Scores [n, P] and velocities [n, P, 2] of the detections taken."""
    score, velocity = np.zeros(row.shape), np.zeros((*row.shape, 2))
    if tracks.past_detection is None:
        return np.where(row >= 0, tracks.score[first][:, None], 0.0), velocity
    for back, observation in enumerate(reversed(seen[-row.shape[1] :]), start=1):
        taken = np.flatnonzero(row[:, -back] >= 0)
        score[taken, -back] = np.asarray(observation["detection_score"])[
            row[taken, -back]
        ]
        velocity[taken, -back] = np.asarray(observation["detection_velocity"])[
            row[taken, -back]
        ]
    return score, velocity


def _ego(seen: Sequence[Observation], past: int) -> Floats:
    """Poses [P, 4] of the platform; without them, zeros."""
    poses = np.array(
        [
            np.asarray(o.get("ego_pose", np.zeros(4)), dtype=np.float64)
            for o in seen[-past:]
        ]
    )
    return np.concatenate([np.repeat(poses[:1], past - len(poses), axis=0), poses])
