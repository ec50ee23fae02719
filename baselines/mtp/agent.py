"""Multi-hypothesis tracking and prediction: the single-hypothesis pipeline with H hypotheses."""

import math

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker


def build(
    task: Task,
    hypotheses: int = 20,
    weighting: str = "posterior",
    temperature: float = 1.0,
    min_score: float = -math.inf,
) -> Agent:
    """``weighting``: "posterior" or "uniform" (the paper's); ``temperature``: of the hypothesis weights.

    ``min_score`` withholds objects whose detections score less on average.
    """
    tracker = HypothesisTracker(hypotheses, temperature=temperature)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), weighting=weighting, min_score=min_score)
