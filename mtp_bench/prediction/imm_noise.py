"""Noise of the three motion models of the IMM predictor, fitted on training splits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..types import Floats, Task
from .motion_noise import most_similar, noise_of, read_store

MODELS = 3  # M: steady velocity, changing velocity, steady acceleration
_STORE = Path(__file__).with_suffix(".toml")


@dataclass(frozen=True, eq=False)
class ImmNoise:
    """Noise per class; the last axis of two is along and across the heading."""

    measurement: Floats  # [C] m, standard deviation of a detected position
    speed: Floats  # [C, 2] m/s, prior standard deviation of a velocity never seen
    # [C, M, 2] white acceleration while the past is filtered, m/s^1.5; of the last model white jerk, m/s^2.5
    jerkiness: Floats
    # [C, M, 2] m/s^2, standard deviation of the acceleration over the future; of the last model its prior
    acceleration: Floats
    stay: Floats  # [C] probability that the model of a frame is that of the frame before


def stored_imm_noise(task: Task) -> ImmNoise:
    """The noise for the task's condition, else of the most similar one, as `stored_noise` chooses it."""
    return noise_of(ImmNoise, most_similar(read_store(_STORE), task))
