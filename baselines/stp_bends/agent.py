"""Control: four of ten samples are bent to the left and right, whatever the object does."""

import numpy as np

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.agent import Forecasts, Frame
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker

TURN_RATES = (0.15, -0.15, 0.3, -0.3)  # rad/s, shared evenly by the bent samples
SHARE = 0.4  # of the samples that are bent


def build(task: Task, turn_rates: list[float] | None = None, share: float = SHARE) -> Agent:
    """Return stp with blind bends."""
    rates = turn_rates or TURN_RATES
    return Pipeline(HypothesisTracker(1), BendPredictor(rates, share), KMeansSampler(), presence=LearnedPresence())


class BendPredictor:
    """Kinematic predictor whose last samples turn at constant rates."""

    def __init__(self, rates, share) -> None:
        self._rates = rates
        self._share = share
        self._straight = KinematicPredictor()

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._straight.reset(task)
        bent = round(self._share * task.k)
        rate = np.zeros(task.k)
        rate[task.k - bent :] = np.resize(self._rates, bent)
        middle = task.dt * (np.arange(task.future) + 0.5)  # s, of each step
        angle = rate[:, None] * middle
        self._cos = np.cos(angle)
        self._sin = np.sin(angle)

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast k samples of each track of the one hypothesis."""
        samples = self._straight.predict(frame).samples
        start = np.broadcast_to(frame.tracks.past[:, None, -1:, :2], (*samples.shape[:2], 1, 2))
        x, y = np.moveaxis(np.diff(samples, axis=2, prepend=start), -1, 0)
        step = np.stack([self._cos * x - self._sin * y, self._sin * x + self._cos * y], axis=-1)
        return Forecasts(start + np.cumsum(step, axis=2))
