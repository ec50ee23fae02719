"""Control: one hypothesis, its samples spread over several lengths of the past."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import HedgedPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task) -> Agent:
    """Equal shares for pasts of 2, 3, 5 and 10 frames, and one sample that stands still."""
    return Pipeline(HypothesisTracker(1), HedgedPredictor(), KMeansSampler(), presence=LearnedPresence())
