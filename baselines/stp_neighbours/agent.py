"""Control: every third sample of an object with a near neighbour is the neighbour's future."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.distance import cdist

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.agent import Forecasts, Frame, Tracks
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker

REACH = 3.0  # m, between the centres of an object and its neighbour


def build(task: Task, draws: int = 20, min_detection_score: float | Mapping[str, float] | None = None) -> Agent:
    """Return stp_same_samples with the futures of neighbours among its samples.

    ``draws`` x k samples from one hypothesis, reduced to k; ``min_detection_score`` as of stp.
    """
    tracker = HypothesisTracker(1, min_detection_score=min_detection_score)
    return Pipeline(tracker, NeighbourPredictor(draws), KMeansSampler(), presence=LearnedPresence())


class NeighbourPredictor:
    """Kinematic predictor that guesses a swap of identities wherever two objects are near.

    It looks at the places of one hypothesis alone: no second hypothesis is weighed, and nothing is trained.
    """

    def __init__(self, draws: int) -> None:
        self._own = KinematicPredictor(draws=draws)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._own.reset(task)

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the tracks of the one hypothesis, a row of draws x k samples each."""
        own = self._own.predict(frame)
        neighbour = nearest_neighbour(frame.tracks)
        near = np.flatnonzero(neighbour >= 0)
        samples = own.samples.copy()
        samples[near, 2::3] = own.samples[neighbour[near], 2::3]
        return Forecasts(samples)


def nearest_neighbour(tracks: Tracks) -> np.ndarray:
    """Return the nearest track [N] of the same class within `REACH`, -1 for none."""
    if len(tracks.box) < 2:
        return np.full(len(tracks.box), -1)
    distance = cdist(tracks.box[:, :2], tracks.box[:, :2])
    distance[tracks.class_id[:, None] != tracks.class_id] = np.inf
    np.fill_diagonal(distance, np.inf)
    nearest = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) <= REACH, nearest, -1)
