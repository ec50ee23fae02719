"""Multi-hypothesis tracking and prediction of detections above a score."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, stored_cuts


def build(task: Task, hypotheses: int = 20) -> Agent:
    """The cuts are those of the task's detector, per class (`mtp_bench/tracking/detection_cuts.toml`)."""
    tracker = HypothesisTracker(hypotheses, min_detection_score=stored_cuts(task))
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
