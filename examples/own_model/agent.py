"""An agent with a network of its own; `examples/train_predictor.py` trains it. NumPy is enough to run it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from mtp_bench import Agent, Forecasts, Frame, Pipeline, Task
from mtp_bench.prediction import (
    GreedySampler,
    LearnedPresence,
    local_inputs,
    to_absolute,
    windows_of,
)
from mtp_bench.tracking import HypothesisTracker

WEIGHTS = Path(__file__).with_name("model.safetensors")


class Mine:
    """Asked once per frame, for the distinct tracks of all hypotheses."""

    def reset(self, task: Task) -> None:
        """Load the weights."""
        self.task, self.net = task, load_file(WEIGHTS)

    def predict(self, frame: Frame) -> Forecasts:
        """The futures of every track, k of each, metres, absolute."""
        windows, row = windows_of(
            frame, self.task.past
        )  # tracks that took the same detections share a window
        seen, net = local_inputs(windows), self.net
        x = (seen["position"] * seen["alive"][:, :, None]).reshape(
            len(windows), 2 * self.task.past
        )
        modes = (
            np.maximum(x @ net["0.weight"].T + net["0.bias"], 0) @ net["2.weight"].T
            + net["2.bias"]
        )
        k = modes.shape[1] // (2 * self.task.future)
        modes = modes.reshape(len(windows), k, self.task.future, 2)
        return Forecasts(to_absolute(windows, modes), row=row)


def build(task: Task, hypotheses: int = 5) -> Agent:
    """The agent."""
    return Pipeline(
        HypothesisTracker(hypotheses),
        Mine(),
        GreedySampler(),
        presence=LearnedPresence(),
    )
