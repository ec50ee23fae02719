"""Windows: what a learned predictor is shown of tracks, the same in training and at work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..agent import Frame, Observation, Tracks
from ..tracks import UNBORN
from ..types import Bools, Floats, Ints, Ragged, starts_of


@dataclass(frozen=True, eq=False)
class Surroundings(Ragged):
    """The detections of m frames, in the frame of the observations; frames of a scene stand one after another."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, 0 where it is not measured
    class_id: Ints  # [R]
    score: Floats  # [R]
    before: Ints  # [m] frames of the same scene that stand before each frame


def surroundings_of(seen: Sequence[Observation]) -> Surroundings:
    """The detections of these frames, of one scene."""
    valid = [np.flatnonzero(np.asarray(observation["detection_valid"])) for observation in seen]
    box, velocity, class_id, score = (
        np.concatenate([np.asarray(o[f"detection_{name}"])[rows] for o, rows in zip(seen, valid, strict=True)])
        for name in ("box", "velocity", "class", "score")
    )
    start = starts_of([len(rows) for rows in valid])
    return Surroundings(start, box, velocity, class_id, score, np.arange(len(seen)))


@dataclass(frozen=True, eq=False)
class TrackWindows:
    """The last P frames of n tracks, in the frame of the observations; the last row is now."""

    box: Floats  # [n, P, 7] the detection taken, else where the tracker thinks it is; 0 before birth
    taken: Bools  # [n, P] a detection was taken; alive and not taken: the track coasts
    alive: Bools  # [n, P] the track is born
    detection: Ints  # [n, P] its row in the observation of that frame; -1: none, or the tracker does not say
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

    def select(self, rows: Ints | Bools | slice) -> TrackWindows:
        """The windows ``rows``."""
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(TrackWindows)})


def shown_as_truth(windows: TrackWindows) -> TrackWindows:
    """Windows as true pasts show them: sure of every box, and with no count of what came before the window."""
    hits, age = (np.maximum(seen.sum(axis=1), 1) for seen in (windows.taken, windows.alive))
    return replace(windows, score=windows.taken.astype(np.float64), hits=hits, age=age)


def windows_of(frame: Frame, past: int) -> tuple[TrackWindows, Ints]:
    """The distinct windows of ``past`` frames of a frame's tracks, and the window [N] of each track.

    Tracks that took the same detections in these frames share the window of the first of them, whatever came before.
    Where such tracks coast, or are of another age, this is not exact: at the simulated intersection with 20 hypotheses
    the forecasts of 2 % of the objects are of another track's window, half of them by more than 0.4 m. A tracker that
    does not state the detections it took has a window for each track.
    """
    tracks = frame.tracks
    length = min(past, tracks.past.shape[1])
    first, window = _distinct(tracks, length)
    taken = tracks.past_valid[first, -length:]
    row = np.where(taken, 0, -1) if tracks.past_detection is None else tracks.past_detection[first, -length:]
    alive = np.maximum.accumulate(taken, axis=1) if tracks.past_detection is None else row != UNBORN
    score, velocity = _measured(tracks, first, row, frame.seen)
    mass = np.exp(tracks.log_weight) @ tracks.member
    windows = TrackWindows(
        box=tracks.past[first, -length:],
        taken=taken,
        detection=np.full(taken.shape, -1) if tracks.past_detection is None else np.maximum(row, -1),
        alive=alive,
        score=score,
        velocity=velocity,
        class_id=tracks.class_id[first],
        hits=np.maximum(taken.sum(axis=1), 1) if tracks.hits is None else tracks.hits[first],
        age=np.maximum(alive.sum(axis=1), 1) if tracks.age is None else tracks.age[first],
        mass=np.bincount(window, mass, minlength=len(first)).astype(np.float64),
        best=np.bincount(window, tracks.member[0], minlength=len(first)) > 0,
        ego=np.broadcast_to(_ego(frame.seen, length), (len(first), length, 4)),
    )
    return (windows if length == past else _longer(windows, past)), window


def _distinct(tracks: Tracks, length: int) -> tuple[Ints, Ints]:
    """The first track of each window and the window [N] of each track."""
    n = len(tracks.box)
    if tracks.past_detection is None or n == 0:
        return np.arange(n), np.arange(n)
    key = np.concatenate([tracks.class_id[:, None], tracks.past_detection[:, -length:]], axis=1)
    nothing = (tracks.past_detection[:, -length:] < 0).all(axis=1)  # then only the identity tells tracks apart
    key = np.concatenate([key, np.where(nothing, tracks.track_id, -1)[:, None]], axis=1)
    _, first, window = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return first, window.reshape(-1)


def _measured(tracks: Tracks, first: Ints, row: Ints, seen: Sequence[Observation]) -> tuple[Floats, Floats]:
    """Scores [n, P] and velocities [n, P, 2] of the detections taken."""
    score, velocity = np.zeros(row.shape), np.zeros((*row.shape, 2))
    if tracks.past_detection is None:
        return np.where(row >= 0, tracks.score[first][:, None], 0.0), velocity
    for back, observation in enumerate(reversed(seen[-row.shape[1] :]), start=1):
        taken = np.flatnonzero(row[:, -back] >= 0)
        score[taken, -back] = np.asarray(observation["detection_score"])[row[taken, -back]]
        velocity[taken, -back] = np.asarray(observation["detection_velocity"])[row[taken, -back]]
    return score, velocity


def _ego(seen: Sequence[Observation], length: int) -> Floats:
    """Poses [P, 4] of the platform; without them, zeros."""
    poses = np.array([np.asarray(o.get("ego_pose", np.zeros(4)), dtype=np.float64) for o in seen[-length:]])
    return np.concatenate([np.repeat(poses[:1], length - len(poses), axis=0), poses])


def _longer(windows: TrackWindows, past: int) -> TrackWindows:
    """The windows with frames before birth put in front, for a predictor that looks further back than the task."""
    more = past - windows.taken.shape[1]
    parts = {}
    for name in ("box", "taken", "alive", "detection", "score", "velocity"):
        value = getattr(windows, name)
        fill = np.full((len(value), more, *value.shape[2:]), -1 if name == "detection" else 0, value.dtype)
        parts[name] = np.concatenate([fill, value], axis=1)
    ego = np.concatenate([np.repeat(windows.ego[:, :1], more, axis=1), windows.ego], axis=1)
    return replace(windows, **parts, ego=ego)
