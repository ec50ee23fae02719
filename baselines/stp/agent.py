"""Single-hypothesis tracking, then prediction."""

from collections.abc import Mapping

import numpy as np

from mtp_bench import Action, Agent, Observation, Pipeline, Task, make_action
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def build(
    task: Task,
    hypotheses: int = 1,
    min_detection_score: float | Mapping[str, float] | None = None,
    assignment: str = "hungarian",
    forecasts: bool = True,
) -> Agent:
    """The pipeline of the paper; with more hypotheses it is MTP.

    ``min_detection_score``: least score of detections that are tracked, a number or one per class.
    ``assignment``: "hungarian" or "greedy". Without ``forecasts`` it states its
    tracks alone, for the runs that weigh the events of an env (envs/reference/README.md).
    """
    tracker = HypothesisTracker(hypotheses, assignment=assignment, min_detection_score=min_detection_score)
    if not forecasts:
        return TracksAlone(tracker)
    return Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())


class TracksAlone:
    """Tracks without forecasts."""

    def __init__(self, tracker: HypothesisTracker) -> None:
        self._tracker = tracker

    def reset(self, task: Task) -> None:
        """Forget everything; a new scene begins."""
        self._task = task
        self._tracker.reset(task)

    def act(self, observation: Observation) -> Action:
        """Answer one frame."""
        tracks, nothing = self._tracker.step(observation), np.zeros((0, self._task.future, 2))
        return make_action(self._task, np.zeros((0, 7)), np.zeros(0, dtype=int), nothing, tracks=tracks, checked=False)
