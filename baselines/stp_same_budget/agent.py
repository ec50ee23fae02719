"""Control: the single-hypothesis pipeline with the sample budget of many hypotheses."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, draws: int = 20) -> Agent:
    """``draws`` x k samples from one hypothesis, reduced to k."""
    return Pipeline(
        HypothesisTracker(1), KinematicPredictor(), KMeansSampler(), presence=LearnedPresence(), draws=draws
    )
