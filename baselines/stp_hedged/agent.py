"""Control: one hypothesis, its samples spread over several readings of the past."""

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import HedgedPredictor, KinematicPredictor, KMeansSampler, LearnedPresence, StandingStill
from mtp_bench.tracking import HypothesisTracker

PASTS = (2, 3, 5, 10)


def build(task: Task) -> Agent:
    """Equal shares for each past window that the env has, and one sample that stands still."""
    readings = [KinematicPredictor(past=past) for past in sorted({min(past, task.past) for past in PASTS})]
    predictor = HedgedPredictor(readings, once=[StandingStill()])
    return Pipeline(HypothesisTracker(1), predictor, KMeansSampler(), presence=LearnedPresence())
