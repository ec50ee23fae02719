"""Tracking, then futures of a learned network."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import GreedySampler, LearnedPredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, TruthTracker


def build(
    task: Task, hypotheses: int = 20, network: str = "ptp", on: str = "truth", weights: str | None = None
) -> Agent:
    """``network`` and what it was trained ``on``; ``weights``: a file of your own in place of the domain's."""
    tracker = TruthTracker() if task.observe == "truth" else HypothesisTracker(hypotheses)
    return Pipeline(tracker, LearnedPredictor(network, on, weights), GreedySampler(), presence=LearnedPresence())
