"""Interface of a network, for agents and for training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...types import Ints, Task
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights
from .local import Arrays


@dataclass(frozen=True)
class Sizes:
    """Sizes of a network. A task may have fewer classes, in any order, and another k; the rest must agree."""

    classes: tuple[str, ...]
    past: int  # P frames, the current one included
    future: int  # T frames
    modes: int  # futures per track
    dt: float  # s

    @classmethod
    def of(cls, task: Task) -> Sizes:
        """Sizes for a task: as many modes as samples that are ranked."""
        return cls(task.classes, task.past, task.future, task.k, task.dt)


class Network(Protocol):
    """Futures of tracks as a function of weights; arrays of NumPy and tensors of torch alike."""

    name: str

    def inputs(self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes) -> Arrays:
        """Its input for n windows, each array [n, ...]; ``moment`` [n]: the frame of each in ``seen``."""
        ...

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Names and shapes of its weights."""
        ...

    def start(self, inputs: Arrays, future: np.ndarray, known: np.ndarray, sizes: Sizes, seed: int) -> Arrays:
        """Weights to start from; statistics of the training data (``future`` [n, T, 2], local) are among them."""
        ...

    def forward(self, weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> dict[str, Array]:
        """Output in the heading frame: ``modes`` [n, S, T, 2] m, ``log_weight`` [n, S] and ``present`` [n, 2] m."""
        ...
