"""Stored tracks of another program, then prediction."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import GivenTracker


def build(task: Task) -> Agent:
    """What stp forecasts and how sure it is, of tracks that the env gives."""
    return Pipeline(GivenTracker(), KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())
