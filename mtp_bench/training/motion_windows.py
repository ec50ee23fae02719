"""Windows for the fits of motion noise: positions of the first hypothesis beside what the object did next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..agent import Observation, Tracker
from ..env.observation import true_detections
from ..prediction.kalman import heading_frame, rotation
from ..tracks import Tracks
from ..types import Bools, Floats, Ints, Scene, Task, joined


@dataclass(frozen=True, eq=False)
class MotionWindows:
    """Windows of n tracks in the heading frame of their last box; the origin is its centre."""

    position: Floats  # [n, P, 2]
    valid: Bools  # [n, P]
    future: Floats  # [n, T, 2]
    class_id: Ints  # [n]


def collect(scenes: Iterable[Scene], task: Task, tracker: Tracker, gate: float = 1.0) -> MotionWindows:
    """Windows of the tracks of the first hypothesis whose true object has all T future frames.

    That is the nearest object of the same class (BEV), at most ``gate`` metres away. With ``task.observe == "truth"``
    the tracker is fed true boxes.
    """
    parts = [_empty(task), *(part for scene in scenes for part in _scene_windows(scene, task, tracker, gate))]
    return joined(parts)


def _scene_windows(scene: Scene, task: Task, tracker: Tracker, gate: float) -> Iterable[MotionWindows]:
    tracker.reset(task)
    for t, observation in enumerate(observations(scene, task.observe)):
        tracks = tracker.step(observation)
        if t + task.future < scene.frames:
            yield _frame_windows(scene, t, tracks, task, gate)


def observations(scene: Scene, observe: str = "detections") -> Iterator[Observation]:
    """The part of the observations that trackers read, frame by frame: unpadded and in the scene's own frame."""
    shown, ids = true_detections(scene) if observe == "truth" else (scene.detections, None)
    for t in range(scene.frames):
        rows = shown.rows(t)
        seen: Observation = {
            "detection_box": shown.box[rows],
            "detection_class": shown.class_id[rows],
            "detection_score": shown.score[rows],
            "detection_velocity": np.nan_to_num(shown.velocity[rows]),
            "detection_valid": np.ones(len(shown.box[rows]), dtype=bool),
        }
        yield seen if ids is None else {**seen, "detection_id": ids[rows]}


def _frame_windows(scene: Scene, t: int, tracks: Tracks, task: Task, gate: float) -> MotionWindows:
    truth = scene.truth
    rows = truth.rows(t)
    now = np.arange(rows.start, rows.stop)[truth.eligible[rows]]
    leaf = np.flatnonzero(tracks.member[0])
    distance = np.linalg.norm(tracks.box[leaf, None, :2] - truth.box[None, now, :2], axis=-1)
    distance = np.where(tracks.class_id[leaf, None] == truth.class_id[None, now], distance, np.inf)
    if distance.size == 0:
        return _empty(task)
    nearest = distance.argmin(axis=1)
    near = distance[np.arange(len(leaf)), nearest] <= gate
    future, complete = _futures(scene, t, truth.object_id[now[nearest]], task.future)
    leaf, future = leaf[near & complete], future[near & complete]
    heading = tracks.box[leaf, 3]
    local = np.einsum("nti,nij->ntj", future - tracks.past[leaf, -1:, :2], rotation(heading))
    position = heading_frame(tracks.past[leaf], heading)
    return MotionWindows(position, tracks.past_valid[leaf], local, tracks.class_id[leaf])


def _futures(scene: Scene, t: int, object_id: Ints, steps: int) -> tuple[Floats, Bools]:
    """Positions [n, T, 2] of objects in the next frames, and whether all of them are known [n]."""
    future = np.zeros((len(object_id), steps, 2))
    complete = np.ones(len(object_id), dtype=bool)
    for step in range(steps):
        rows = scene.truth.rows(t + 1 + step)
        same = object_id[:, None] == scene.truth.object_id[None, rows]
        complete &= same.any(axis=1)
        if same.size:
            future[:, step] = scene.truth.box[rows, :2][same.argmax(axis=1)]
    return future, complete


def _empty(task: Task) -> MotionWindows:
    return MotionWindows(
        np.zeros((0, task.past, 2)),
        np.zeros((0, task.past), dtype=bool),
        np.zeros((0, task.future, 2)),
        np.zeros(0, dtype=np.int64),
    )
