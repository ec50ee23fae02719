"""What the forecasts of a scene are worth at every cut: a cut keeps those of at least some confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Floats, Ints
from .additions import Additions, last_of
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


def cuts_of(
    additions: Additions,
    false_step: Rows,
    order: Rows,
    confidence: Floats,
    frame: Ints,
    class_id: Ints,
    target_of_row: Rows,
    pair_error: Floats,
    miss_error: Floats,
) -> Cuts:
    """The cuts of one scene.

    ``additions``: of the forecasts in ``order`` [A], the surest first, as columns; ``false_step``: the steps at which
    one more is false. ``confidence``, ``frame`` and ``class_id`` are those of all forecasts. ``target_of_row`` [rows]:
    the target that each true box is, -1 for none. ``pair_error`` [E]: minADE of the pairs of ``additions``, inf where
    the forecast is not usable; ``miss_error`` [n] of the targets.
    """
    target = target_of_row[additions.row]
    of_target = target >= 0
    target, error = target[of_target], pair_error[of_target]
    false = np.zeros(len(order), dtype=bool)
    false[false_step] = True
    return Cuts(
        confidence=confidence[order],
        frame=frame[order],
        class_id=class_id[order],
        false=false,
        step=additions.step[of_target],
        target=target,
        error=np.minimum(error, miss_error[target]),
        covered=np.isfinite(error),
        miss_error=miss_error,
    )
