"""Reference: the single-hypothesis pipeline with perfect association of the same detections."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, draws: int = 1) -> Agent:
    """``draws`` x k samples of each track, reduced to k; tracks keep the identities that the env gives."""
    return Pipeline(HypothesisTracker(1), KinematicPredictor(draws=draws), KMeansSampler(), presence=LearnedPresence())
