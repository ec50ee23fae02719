"""The ideal: prediction from ground-truth tracks."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import TruthTracker


def build(task: Task, draws: int = 1) -> Agent:
    """``draws`` x k samples of each track, reduced to k."""
    return Pipeline(TruthTracker(), KinematicPredictor(draws=draws), KMeansSampler())
