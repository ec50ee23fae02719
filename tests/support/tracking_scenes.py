"""Frames of detections for tests of trackers, and what an observation of them looks like."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mtp_bench.agent import Tracker
from mtp_bench.core import Bools, Floats, Ints, Observation, Task
from mtp_bench.core.tracks import Tracks
from mtp_bench.prediction.presence import file_of, read_model
from mtp_bench.tracking import ClassParameters, detector_parameters

CAR, PEDESTRIAN, CYCLIST = 0, 1, 2
SIZE = np.array([[4.0, 1.8, 1.5], [0.7, 0.6, 1.75], [1.8, 0.6, 1.7]])  # l w h of the three classes

Frame = tuple[Floats, Ints]  # boxes [D, 7] and classes [D]


def kitti_task(**changes: Any) -> Task:
    return replace(
        Task(
            env_id="test", classes=("car", "pedestrian", "cyclist"), dt=0.1036, past=10, future=10, k=20, samples=20,
            detections=40, tracks=640, objects=80, hypotheses=20, detector="pointrcnn",
        ),
        **changes,
    )  # fmt: skip


def at_once() -> tuple[ClassParameters, ...]:
    """AB3DMOT's parameters, but every track is output from its first detection on: nothing is hidden."""
    return tuple(replace(rule, min_hits=1) for rule in detector_parameters("pointrcnn", kitti_task().classes))


def frame(*objects: tuple[float, float, int]) -> Frame:
    """Detections at (x, y) of a class, all heading along x."""
    class_id = np.array([c for _, _, c in objects], dtype=np.int64)
    box = np.zeros((len(objects), 7))
    for row, (x, y, c) in zip(box, objects, strict=True):
        row[:] = x, y, SIZE[c, 2] / 2, 0.0, *SIZE[c]
    return box, class_id


def observation(detections: Frame) -> Observation:
    box, class_id = detections
    return {
        "detection_box": box,
        "detection_class": class_id,
        "detection_score": np.arange(1.0, len(box) + 1),
        "detection_velocity": np.zeros((len(box), 2)),
        "detection_valid": np.ones(len(box), dtype=np.int8),
    }


def run(tracker: Tracker, frames: Iterable[Frame], task: Task | None = None) -> Iterator[Tracks]:
    tracker.reset(task or kitti_task())
    for detections in frames:
        yield tracker.step(observation(detections))


def random_frames(rng: np.random.Generator, frames: int, objects: int = 8, area: float = 12.0) -> list[Frame]:
    """A crowd of all three classes that walks about ``area`` metres, with noise, false positives and flipped headings.

    Some objects are undetected. Objects come and go; now and then a frame has no detection at all.
    """
    class_id = rng.integers(0, 3, objects)
    position, heading = rng.uniform(0, area, (objects, 2)), rng.uniform(-np.pi, np.pi, objects)
    speed, first = rng.uniform(0, 0.8, objects), rng.integers(0, frames // 2, objects)
    last = first + rng.integers(3, frames, objects)
    result: list[Frame] = []
    for t in range(frames):
        heading = heading + rng.normal(0, 0.1, objects)
        position = position + speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        seen = np.flatnonzero((first <= t) & (t <= last) & (rng.random(objects) < 0.85))
        false = rng.poisson(0.7)
        kind = np.concatenate([class_id[seen], rng.integers(0, 3, false)])
        box = np.zeros((len(kind), 7))
        box[:, :2] = np.concatenate([position[seen], rng.uniform(0, area, (false, 2))])
        box[:, 3] = np.concatenate([heading[seen] + np.pi * (rng.random(len(seen)) < 0.1), np.zeros(false)])
        box[:, 4:] = SIZE[kind] * rng.uniform(0.9, 1.1, (len(kind), 3))
        box[:, 2] = box[:, 6] / 2
        box[:, :4] += rng.normal(0, 0.1, (len(kind), 4))
        order = rng.permutation(len(kind)) if rng.random() < 0.95 else np.zeros(0, dtype=np.int64)
        result.append((box[order], kind[order]))
    return result


def tracks_with_past(past: Floats, valid: Bools | None = None, class_id: Ints | None = None) -> Tracks:
    """One hypothesis with tracks of these pasts [N, P, 7], seen in every frame unless told otherwise."""
    n, length = past.shape[:2]
    return Tracks(
        track_id=np.arange(n), box=past[:, -1].copy(),
        class_id=np.zeros(n, dtype=np.int64) if class_id is None else class_id, score=np.ones(n),
        detection=np.arange(n), past=past, past_valid=np.ones((n, length), dtype=bool) if valid is None else valid,
        member=np.ones((1, n), dtype=bool), log_weight=np.zeros(1),
    )  # fmt: skip


def fitted_on(detector: str) -> set[str]:
    """Names of the scenes that the presence of a detector was fitted on."""
    return {name for part in read_model(file_of(detector)).fitted_on for name in part.scenes}
