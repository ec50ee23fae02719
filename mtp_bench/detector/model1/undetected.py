"""Which objects are undetected: log-odds by distance, occlusion and truncation, with memory from frame to frame."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats
from ..chains import at_period, stationary, two_state
from ..sight import Sight, features
from .draws import Grid, Kind, Streams


def undetected(grid: Grid, sight: Sight, covered: Bools, seed: int) -> Bools:
    """Whether each row of the truth is undetected ``[R]``; a row that the sensor does not cover always is.

    An object is seen for the first time in its first covered frame, and again after any frame without it.
    """
    uniform = Streams(seed).of(Kind.UNDETECTED).random(grid.shape)
    present = np.zeros(grid.shape, dtype=bool)
    present[grid.frame, grid.column] = covered
    begins = present.copy()
    begins[1:] &= ~present[:-1]
    chance = np.zeros((3, *grid.shape))
    chance[:, grid.frame, grid.column] = chances(grid, sight)
    state = two_state((chance[0], chance[1], chance[2]), begins, uniform)
    return ~covered | grid.rows_of(state)


def chances(grid: Grid, sight: Sight) -> tuple[Floats, Floats, Floats]:
    """Chance of being undetected in the first frame, after a detection, and after a frame without: ``[R]`` each."""
    seen = features(sight)
    first = _sigmoid((seen * grid.of_rows(lambda noise: noise.miss.first)).sum(-1))
    later = grid.of_rows(lambda noise: noise.miss.later)
    logit = (seen * later[:, :6]).sum(-1)
    after_hit, after_none = at_period(_sigmoid(logit), _sigmoid(logit + later[:, 6]), grid.steps)
    memory = grid.of_rows(lambda noise: noise.miss.memory) > 0
    long_run = stationary(after_hit, after_none)
    return first, np.where(memory, after_hit, long_run), np.where(memory, after_none, long_run)


def _sigmoid(logit: Floats) -> Floats:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))  # never overflows
