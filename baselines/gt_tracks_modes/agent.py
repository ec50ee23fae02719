"""Futures of a network from ground-truth tracks."""

from collections.abc import Mapping

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import GreedySampler, LearnedPredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, TruthTracker


def build(
    task: Task,
    hypotheses: int = 20,
    on: str = "truth",
    weights: str | None = None,
    min_detection_score: float | Mapping[str, float] | None = None,
) -> Agent:
    """``on``: what the network was trained on; ``weights``: your own file in place of the env's.

    ``min_detection_score``: least score of detections that are tracked, a number or one per class.
    """
    tracker = HypothesisTracker(hypotheses, min_detection_score=min_detection_score)
    return Pipeline(
        TruthTracker() if task.observe == "truth" else tracker,
        LearnedPredictor("modes", on, weights),
        GreedySampler(),
        presence=LearnedPresence(),
    )
