"""Single-hypothesis tracking, then prediction."""

import math

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, hypotheses: int = 1, min_score: float = -math.inf) -> Agent:
    """The pipeline of the paper; with more hypotheses it is MTP. ``min_score`` withholds objects of weak detections."""
    return Pipeline(HypothesisTracker(hypotheses), KinematicPredictor(), KMeansSampler(), min_score=min_score)
