"""Single-hypothesis tracking, then futures along the lanes that the observation shows, and free ones."""

from collections.abc import Mapping

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KMeansSampler, LanePredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, TruthTracker


def build(
    task: Task,
    hypotheses: int = 1,
    draws: int = 1,
    min_detection_score: float | Mapping[str, float] | None = None,
) -> Agent:
    """``draws`` x k samples of each track, reduced to k. Without lanes in ``task`` it is stp, or mtp.

    ``min_detection_score``: least score of detections that are tracked, a number or one per class.
    """
    tracker = HypothesisTracker(hypotheses, min_detection_score=min_detection_score)
    return Pipeline(
        TruthTracker() if task.observe == "truth" else tracker,
        LanePredictor(draws=draws),
        KMeansSampler(),
        presence=LearnedPresence(),
    )
