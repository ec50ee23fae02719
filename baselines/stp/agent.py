"""Single-hypothesis tracking, then prediction."""

from collections.abc import Mapping

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, hypotheses: int = 1, min_detection_score: float | Mapping[str, float] | None = None) -> Agent:
    """The pipeline of the paper; with more hypotheses it is MTP.

    ``min_detection_score``: weaker detections are not tracked, a number or one per class.
    """
    tracker = HypothesisTracker(hypotheses, min_detection_score=min_detection_score)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
