"""What the forecasts of a scene are worth at every cut: a cut keeps those of at least some confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Floats, Ints
from .additions import last_of
from .pairs import Rows


@dataclass(frozen=True, eq=False)
class Cuts:
    """The A forecasts in live frames, surest first, and the E changes of errors as they are added one by one."""

    confidence: Floats  # [A] falling
    frame: Ints  # [A]
    class_id: Ints  # [A]
    false: Bools  # [A] adding it makes one more false forecast
    step: Rows  # [E] the forecast whose addition changes something, rising
    target: Rows  # [E] what it changes
    error: Floats  # [E] m, of the target from then on, at most c
    covered: Bools  # [E] whether the target has a forecast from then on
    miss_error: Floats  # [n] m, c of each target

    def at(self, least: float) -> tuple[Floats, Floats]:
        """Error of each target [n] and the part of it that targets without a forecast make, m.

        ``least``: the least confidence that is kept.
        """
        kept = int(np.searchsorted(-self.confidence, -least, side="right"))
        changes = int(np.searchsorted(self.step, kept))
        error, missed = self.miss_error.copy(), self.miss_error.copy()
        last = last_of(self.target[:changes])
        target = self.target[last]
        error[target] = self.error[last]
        missed[target[self.covered[last]]] = 0.0
        return error, missed

    def false_costs(self, least: float, cost: Floats) -> float:
        """``cost`` [C] of each class, summed over the false forecasts among those of confidence ``least`` and more."""
        return float(cost[self.class_id[self.false & (self.confidence >= least)]].sum())
