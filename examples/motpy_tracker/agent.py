"""The tracker of the package `motpy`, which follows boxes of images, on bird's-eye rectangles."""

import copy
from typing import Any

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import BirdsEye, OnlineDetections, OnlineTracker

SECONDS = 1.0  # that a track is kept without a detection


class MotpyTracker:
    """motpy's ``step``: its tracks hold filtered rectangles and do not say which detection they took."""

    def __init__(self, task: Task, min_iou: float) -> None:
        from motpy import ModelPreset, MultiObjectTracker

        preset = ModelPreset.constant_velocity_and_static_box_size_2d.value
        self._tracker = MultiObjectTracker(
            dt=task.dt,
            model_spec=copy.deepcopy(
                preset
            ),  # it writes dt into what it is given, and all trackers share the preset
            matching_fn_kwargs={"min_iou": min_iou},
            tracker_kwargs={"max_staleness": max(1.0, SECONDS / task.dt)},
        )

    def update(self, detections: OnlineDetections) -> list[tuple[Any, ...]]:
        """Rows (id, rectangle, score): the adapter finds their detections by place."""
        from motpy import Detection

        pairs = zip(detections.rectangle, detections.score, strict=True)
        found = self._tracker.step(
            [Detection(box=box, score=float(score)) for box, score in pairs]
        )
        return [(track.id, track.box, track.score) for track in found]


def build(task: Task, padding: float = 0.5, min_iou: float = 0.1) -> Agent:
    """``padding``: m around every box; ``min_iou``: of rectangles, from which on a track may take a detection."""
    wrapped = OnlineTracker(
        lambda task: MotpyTracker(task, min_iou),
        per_class=True,
        view=BirdsEye(10.0, padding),
    )
    return Pipeline(
        wrapped, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence()
    )
