"""Multi-hypothesis tracking and prediction: the single-hypothesis pipeline with H hypotheses."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(
    task: Task,
    hypotheses: int = 20,
    weighting: str = "posterior",
    temperature: float = 1.0,
    per_cluster: bool = False,
) -> Agent:
    """``weighting``: "posterior" or "uniform" (the paper's); ``temperature``: of the hypothesis weights.

    ``per_cluster``: alternatives for all
    clusters of tracks at once, in place of the cheapest hypotheses overall.
    """
    tracker = HypothesisTracker(hypotheses, temperature=temperature, per_cluster=per_cluster)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence(), weighting=weighting)
