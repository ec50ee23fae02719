"""Control: four of ten samples bend to the left and right, without evidence."""

import numpy as np

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.agent import Forecasts, Frame
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker

TURN_RATES = (0.2, -0.2, 0.3, -0.3)  # rad/s, shared evenly by the bent samples
BENT_SHARE = 0.4  # of the samples


def build(task: Task) -> Agent:
    """Return stp with blind bends."""
    return Pipeline(HypothesisTracker(1), BendPredictor(), KMeansSampler(), presence=LearnedPresence())


class BendPredictor:
    """Kinematic predictor whose last samples turn at constant rates.

    The rates were chosen on 20 training scenes each of Intersection and Roundabout, for targets that turn: 0.3 rad/s
    was the better single rate at the one, 0.2 at the other. Nothing that is observed decides which samples bend.
    """

    def __init__(self) -> None:
        self._straight = KinematicPredictor()

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._straight.reset(task)
        bent = round(BENT_SHARE * task.k)
        rate = np.zeros(task.k)
        rate[task.k - bent :] = np.resize(TURN_RATES, bent)
        middle = task.dt * (np.arange(task.future) + 0.5)  # s, of each step
        angle = rate[:, None] * middle
        self._cos = np.cos(angle)
        self._sin = np.sin(angle)

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast k samples of each track of the one hypothesis."""
        samples = self._straight.predict(frame).samples
        start = np.broadcast_to(frame.tracks.past[:, None, -1:, :2], (*samples.shape[:2], 1, 2))
        step_x, step_y = np.moveaxis(np.diff(samples, axis=2, prepend=start), -1, 0)
        bent_x = self._cos * step_x - self._sin * step_y
        bent_y = self._sin * step_x + self._cos * step_y
        return Forecasts(start + np.cumsum(np.stack([bent_x, bent_y], axis=-1), axis=2))
