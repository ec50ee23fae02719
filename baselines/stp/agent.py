"""Single-hypothesis tracking, then prediction."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, hypotheses: int = 1) -> Agent:
    """The pipeline of the paper; with more hypotheses it is MTP."""
    return Pipeline(HypothesisTracker(hypotheses), KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
