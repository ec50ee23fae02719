"""Multi-hypothesis tracking and prediction: the single-hypothesis pipeline with H hypotheses."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, hypotheses: int = 20, weighting: str = "posterior", temperature: float = 1.0) -> Agent:
    """``weighting``: "posterior" or "uniform" (the paper's); ``temperature``: of the hypothesis weights."""
    tracker = HypothesisTracker(hypotheses, temperature=temperature)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), weighting=weighting)
