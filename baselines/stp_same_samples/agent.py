"""Control: the single-hypothesis pipeline with the sample budget of many hypotheses."""

from collections.abc import Mapping

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, draws: int = 20, min_detection_score: float | Mapping[str, float] | None = None) -> Agent:
    """``draws`` x k samples from one hypothesis, reduced to k; ``min_detection_score`` as of stp."""
    tracker = HypothesisTracker(1, min_detection_score=min_detection_score)
    return Pipeline(tracker, KinematicPredictor(draws=draws), KMeansSampler(), presence=LearnedPresence())
