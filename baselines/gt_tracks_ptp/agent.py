"""Futures of PTP from ground-truth tracks."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import GreedySampler, LearnedPredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, TruthTracker


def build(
    task: Task, hypotheses: int = 20, network: str = "ptp", on: str = "truth", weights: str | None = None
) -> Agent:
    """``network`` and what it was trained ``on``; ``weights``: your own file in place of the env's."""
    tracker = TruthTracker() if task.observe == "truth" else HypothesisTracker(hypotheses)
    return Pipeline(tracker, LearnedPredictor(network, on, weights), GreedySampler(), presence=LearnedPresence())
