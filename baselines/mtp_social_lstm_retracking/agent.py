"""Several hypotheses over SORT with re-tracking, then Social-LSTM: the paper's MTP with re-tracking."""

from mtp_bench import Agent, Pipeline, Task, Tracker
from mtp_bench.prediction import GreedySampler, LearnedPredictor, LearnedPresence
from mtp_bench.tracking import HypothesisTracker, ReTracker, TruthTracker, sort_parameters


def build(
    task: Task, hypotheses: int = 1, retracking: bool = False, on: str = "truth", weights: str | None = None
) -> Agent:
    """``retracking``: forecasts are tracked too (Yu, Zhou 2021); ``weights``: your own file."""
    predictor = LearnedPredictor("social_lstm", on, weights)
    tracker: Tracker = (
        TruthTracker() if task.observe == "truth" else HypothesisTracker(hypotheses, sort_parameters(task.classes))
    )
    if retracking and task.observe != "truth":
        tracker = ReTracker(tracker, predictor)
    return Pipeline(tracker, predictor, GreedySampler(), presence=LearnedPresence())
