"""Stored tracks of another program, then prediction."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import GivenTracker


def build(task: Task) -> Agent:
    """Forecasts and presence of stp, for tracks that the env gives."""
    return Pipeline(GivenTracker(), KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
