"""Two-state chains over frames, and correlations at another frame period."""

from __future__ import annotations

import numpy as np

from ..types import Bools, Floats

_TINY = 1e-300
_WHOLE = 1e-6  # frame periods are quotients of decimal numbers


def stationary(after_no: Floats, after_yes: Floats) -> Floats:
    """Long-run chance of "yes" in a chain with these chances of it after a "no" and after a "yes"."""
    return after_no / np.maximum(1.0 - after_yes + after_no, _TINY)


def at_period(after_no: Floats, after_yes: Floats, steps: float) -> tuple[Floats, Floats]:
    """Both chances of the chain seen every ``steps`` frames: the long-run chance stays, the correlation decays.

    Exact for whole steps; ``steps=inf`` forgets everything.
    """
    if steps == 1.0:
        return after_no, after_yes
    long_run = stationary(after_no, after_yes)
    correlation = decayed(after_yes - after_no, steps)
    return long_run * (1.0 - correlation), long_run + (1.0 - long_run) * correlation


def decayed(correlation: Floats, steps: float) -> Floats:
    """Correlation between neighbouring frames, over ``steps`` of them.

    Over half a frame a negative one has no meaning: it keeps its sign there.
    """
    whole = np.isfinite(steps) and abs(steps - round(steps)) < _WHOLE
    sign = np.sign(correlation) ** round(steps) if whole else np.sign(correlation)
    return np.asarray(sign * np.abs(correlation) ** steps)


def two_state(chance: tuple[Floats, Floats, Floats], begins: Bools, uniform: Floats) -> Bools:
    """Runs of a two-state chain for many objects at once ``[F, J]``.

    ``chance`` of "yes" where the chain begins, after a "no" and after a "yes", ``[F, J]`` or ``[J]``; ``uniform`` in
    [0, 1): ``[F, J]``.
    """
    first, after_no, after_yes = chance
    yes_after_no = uniform < np.where(begins, first, after_no)
    yes_after_yes = uniform < np.where(begins, first, after_yes)
    state = np.zeros(uniform.shape, dtype=bool)
    previous = np.zeros(uniform.shape[1:], dtype=bool)
    for t in range(len(state)):
        previous = state[t] = np.where(previous, yes_after_yes[t], yes_after_no[t])
    return state
