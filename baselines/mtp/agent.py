"""Multi-hypothesis tracking and prediction: the single-hypothesis pipeline with H hypotheses."""

from collections.abc import Mapping

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(
    task: Task,
    hypotheses: int = 20,
    weighting: str = "posterior",
    temperature: float = 1.0,
    min_detection_score: float | Mapping[str, float] | None = None,
) -> Agent:
    """``weighting``: "posterior" or "uniform" (the paper's); ``temperature``: of the hypothesis weights.

    ``min_detection_score``: least score of detections that are tracked, a number or one per class.
    """
    tracker = HypothesisTracker(hypotheses, temperature=temperature, min_detection_score=min_detection_score)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence(), weighting=weighting)
