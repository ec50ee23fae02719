"""AB3DMOT as the paper runs it, then prediction: stp with AB3DMOT's own assignment per class."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task) -> Agent:
    """One hypothesis; greedy where AB3DMOT is greedy."""
    return Pipeline(
        HypothesisTracker(assignment="as_parameters"), KinematicPredictor(), KMeansSampler(), presence=LearnedPresence()
    )
