"""Values that wander: one for everybody, kept by number."""

from __future__ import annotations

import math

import numpy as np

from ...types import Floats, Ints

_MORE = 64  # values that are drawn at once


class Drift:
    """An Ornstein-Uhlenbeck process for each number: normal around 0 with a ``spread``, forgotten in ``memory`` s."""

    def __init__(self, spread: float, memory: float, dt: float, rng: np.random.Generator) -> None:
        self._spread, self._rng = spread, rng
        self._kept = math.exp(-dt / memory)
        self._kick = spread * math.sqrt(1.0 - self._kept**2)
        self._value: Floats = np.zeros(0)

    def step(self, numbers: Ints) -> Floats:
        """The values ``[n]`` of ``numbers`` ``[n]`` after ``dt`` seconds; those of the others stay as they are."""
        missing = int(numbers.max(initial=-1)) + 1 - len(self._value)
        if missing > 0:
            drawn = self._spread * self._rng.standard_normal(missing + _MORE)
            self._value = np.concatenate([self._value, np.round(drawn, 6)])
        moved = self._kept * self._value[numbers] + self._kick * self._rng.standard_normal(len(numbers))
        self._value[numbers] = np.round(moved, 6)
        return self._value[numbers]
