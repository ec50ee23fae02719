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
    per_cluster: bool = False,
) -> Agent:
    """``weighting``: "posterior" or "uniform" (the paper's); ``temperature``: of the hypothesis weights.

    ``min_score`` withholds objects whose detections score less on average. ``per_cluster``: alternatives for all
    clusters of tracks at once, in place of the cheapest hypotheses overall.
    """
    tracker = HypothesisTracker(hypotheses, temperature=temperature, per_cluster=per_cluster)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), weighting=weighting, min_score=min_score)
