"""Futures from soft assignments of detections; tracking only determines which objects exist."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import GreedySampler, LearnedPredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, TruthTracker


def build(
    task: Task,
    network: str = "affinity",
    on: str = "tracklets",
    weights: str | None = None,
    association: str = "network",
) -> Agent:
    """``network`` and what it was trained ``on``; ``weights``: your own file in place of the env's.

    ``association``: the network's input, "network": all detections around an object, "track": only those of its track.
    """
    tracker = TruthTracker() if task.observe == "truth" else HypothesisTracker(1)
    predictor = LearnedPredictor(network, on, weights, association=association)
    return Pipeline(tracker, predictor, GreedySampler(), presence=LearnedPresence())
