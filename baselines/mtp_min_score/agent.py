"""Multi-hypothesis tracking and prediction of detections above a score."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, score_thresholds


def build(task: Task, hypotheses: int = 20) -> Agent:
    """The score thresholds are those of the task's detector, per class (`mtp_bench/tracking/detectors`)."""
    tracker = HypothesisTracker(hypotheses, min_detection_score=score_thresholds(task))
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
