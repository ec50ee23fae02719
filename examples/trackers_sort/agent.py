"""SORT or ByteTrack of the package `trackers`, which follows boxes of images, on bird's-eye rectangles."""

from typing import Any

import numpy as np

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import BirdsEye, OnlineDetections, OnlineTracker

SECONDS = 1.0  # that a track is kept without a detection


class Wrapped:
    """A tracker of `trackers`: supervision's detections in, the same out with a ``tracker_id``."""

    def __init__(self, task: Task, name: str, minimum_iou_threshold: float) -> None:
        import trackers

        self._tracker = getattr(trackers, name)(
            frame_rate=1 / task.dt,
            lost_track_buffer=round(
                30 * SECONDS
            ),  # counted in frames of 30 Hz, whatever the rate
            minimum_consecutive_frames=1,
            minimum_iou_threshold=minimum_iou_threshold,
            track_activation_threshold=0.0,  # the presence model says what is there
        )

    def update(self, detections: OnlineDetections) -> list[tuple[Any, ...]]:
        """Rows (id, box, score, detection) of the detections that have an id."""
        import supervision

        given = supervision.Detections(
            xyxy=detections.rectangle,
            confidence=1
            / (
                1 + np.exp(-detections.score)
            ),  # a logit may be negative; the order stays
            data={"row": np.arange(len(detections))},
        )
        found = self._tracker.update(given)
        if found.tracker_id is None:
            return []
        rows = np.asarray(found.data.get("row", []), dtype=int)
        taken = zip(found.tracker_id.tolist(), rows.tolist(), strict=True)
        return [
            (i, detections.box[row], detections.score[row], row)
            for i, row in taken
            if i >= 0
        ]


def build(
    task: Task,
    tracker: str = "SORTTracker",
    padding: float = 0.5,
    minimum_iou_threshold: float = 0.1,
) -> Agent:
    """``tracker``: SORTTracker, ByteTrackTracker or another class of the package; ``padding``: m around every box."""
    wrapped = OnlineTracker(
        lambda task: Wrapped(task, tracker, minimum_iou_threshold),
        per_class=True,
        view=BirdsEye(10.0, padding),
    )
    return Pipeline(
        wrapped, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence()
    )
