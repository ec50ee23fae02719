"""Budgeted ADE (bADE) and its relatives: errors of targets at confidence thresholds.

| number | forecasts that are kept |
|---|---|
| plain error | all |
| fixed error | those of a confidence of at least 0.5; false ones cost c / 2 |
| bADE | as many as a budget of false forecasts allows, averaged over budgets |

A cut is a confidence threshold: it keeps the forecasts of at least that confidence. The
error at a budget is that of the last cut within it; the rest of the budget counts as a
share of the next cut (docs/definitions, "bADE").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints
from .definitions import (
    BUDGETS,
    FALSE_FORECAST_SHARE,
    FIXED_CONFIDENCE,
    FORECASTS_PER_FRAME,
    FREE_FORECASTS,
)
from .incremental_matching import last_of
from .pairs import Rows


@dataclass(frozen=True, eq=False)
class Cuts:
    """Forecasts of live frames by falling confidence, and the errors as they are added.

    ``A`` forecasts, ``E`` changes of errors.
    """

    confidence: Floats  # [A] falling
    frame: Ints  # [A]
    class_id: Ints  # [A]
    false: Bools  # [A] adding it makes one more false forecast
    step: Rows  # [E] the forecast whose addition changes an error, rising
    target: Rows  # [E] the target whose error changes
    error: Floats  # [E] m, of the target from then on, at most c
    covered: Bools  # [E] True if the target has a forecast from then on
    miss_error: Floats  # [n] m, c of each target

    def at(self, min_confidence: float) -> tuple[Floats, Floats]:
        """Return the error of each target [n], m, at a confidence threshold.

        The second result is the part of it from targets without a forecast.
        """
        kept = np.searchsorted(-self.confidence, -min_confidence, side="right")
        changes = int(np.searchsorted(self.step, kept))
        final_change = last_of(self.target[:changes])
        target = self.target[final_change]
        error = self.miss_error.copy()
        error[target] = self.error[final_change]
        missed = self.miss_error.copy()
        missed[target[self.covered[final_change]]] = 0.0
        return error, missed

    def false_costs(self, min_confidence: float, cost: Floats) -> float:
        """Return the cost of false forecasts of ``min_confidence`` and more.

        ``cost`` [C]: cost of a false forecast of each class.
        """
        counted = self.false & (self.confidence >= min_confidence)
        return float(cost[self.class_id[counted]].sum())


@dataclass(frozen=True, eq=False)
class Budgets:
    """Numbers of false forecasts that are allowed.

    If false ones are unknown, forecasts per live frame.
    """

    all: Floats  # bADE of "all" is the mean over these
    subsets: float  # the one budget of the event subsets
    false_known: bool = True


@dataclass(frozen=True)
class CardBudget:
    """Constants of a card that set its budgets.

    The constants are counts of the reference STP on the scored split. Budgets do not
    depend on the detections that an agent gets. Otherwise worse detections would widen
    the budgets and lower the error.
    """

    env: str = ""  # id of the card; empty: its scored split has no frozen counts
    forecasts: int = 1  # false ones of STP; all of them if false ones are unknown
    divisor: int = 1  # targets; live frames if false forecasts are unknown
    # False: the truth of the scored split holds prediction targets alone
    false_known: bool = True

    def fit_for(self, false_known: bool) -> "CardBudget":
        """Return the constants for scenes whose false forecasts are known or not.

        Constants of the other kind do not fit: then the defaults, without an env.
        """
        if self.false_known == false_known:
            return self
        return CardBudget(false_known=false_known)

    def budgets(self, targets: int, false_known: bool = True) -> Budgets:
        """Return the budgets of a run with this number of targets.

        They reach up to the rate of false forecasts of STP; those of "all" are equal
        steps, up to at most one per target. ``false_known``: False where the truth of
        the run's scenes holds prediction targets alone.
        """
        constants = self.fit_for(false_known)
        if not false_known:
            per_frame = list(FORECASTS_PER_FRAME)
            if constants.env:
                per_frame.append(constants.forecasts / constants.divisor)
            return Budgets(np.array(per_frame), per_frame[-1], false_known=False)
        # multiplied first: exact on the scored split
        limit = constants.forecasts * targets / constants.divisor
        steps = np.arange(1, BUDGETS + 1)
        return Budgets(all=steps * min(float(targets), limit) / BUDGETS, subsets=limit)

    def text(self, false_known: bool = True) -> str:
        """Return the budgets of a run and their source in words, for a report."""
        constants = self.fit_for(false_known)
        source = "no constant for such scenes"
        if constants.env:
            source = f"constant of {constants.env}"
        if not false_known:
            # budgets per live frame do not depend on targets
            budgets = self.budgets(targets=0, false_known=False)
            rates = ", ".join(f"{rate:.3g}" for rate in budgets.all)
            return (
                f"{rates} forecasts per live frame, as false ones are not known "
                f"({source})"
            )
        rate = constants.forecasts / constants.divisor
        # the subset "all" allows one false forecast per target at most
        limit = ", over all targets up to 1" if rate > 1 else ""
        return f"up to {rate:.3g} per target{limit} ({source})"


ONE_PER_TARGET = CardBudget()


@dataclass(frozen=True, eq=False)
class BudgetErrors:
    """Errors of one run, per budget b and target."""

    error: Floats  # [b, n] m
    missed: Floats  # [b, n] m, the part from targets without a forecast


def errors_at(
    cuts: Sequence[Cuts],
    budgets: Sequence[float] | Floats,
    live_frames: int | None = None,
) -> BudgetErrors:
    """Return the errors of one run at each of the ``budgets``.

    ``cuts``: cuts of each scene of the run. ``live_frames``: number of live frames of
    the run, if a budget is a number of forecasts per live frame. None: a budget is a
    number of false forecasts.
    """

    def scene_errors(scene: int, min_confidence: float) -> Floats:
        return np.stack(cuts[scene].at(min_confidence))

    errors = at_budgets(cuts, budgets, scene_errors, live_frames)
    return BudgetErrors(errors[:, 0], errors[:, 1])


def at_budgets(
    cuts: Sequence[Cuts],
    budgets: Sequence[float] | Floats,
    value: Callable[[int, float], Floats],
    live_frames: int | None = None,
) -> Floats:
    """Return p values of each target at each budget [b, p, n].

    They are interpolated linearly between the two cuts around a budget.
    ``value(scene, min_confidence)``: values [p, targets] of the scene of this index at
    a least kept confidence. The other arguments are those of `errors_at`.
    """
    confidence = np.concatenate([cut.confidence for cut in cuts])
    order = np.argsort(-confidence, kind="stable")
    # of what a budget limits, in the most confident forecasts
    if live_frames is None:
        count = np.cumsum(np.concatenate([cut.false for cut in cuts])[order])
    else:
        count = np.arange(1, len(order) + 1) / max(live_frames, 1)
    # a cut keeps all forecasts of equal confidence: up to the last of its level
    level, first = np.unique(-confidence[order], return_index=True)
    level_count = count[np.append(first, len(confidence))[1:] - 1]
    cached: dict[int, Floats] = {}

    def at_level(index: int) -> Floats:
        """Return values at the cut of this level.

        -1 keeps no forecast.
        """
        if index not in cached:
            min_confidence = -float(level[index]) if index >= 0 else np.inf
            values = [value(scene, min_confidence) for scene in range(len(cuts))]
            cached[index] = np.concatenate(values, axis=1)
        return cached[index]

    budget_values = []
    for budget in np.asarray(budgets, dtype=np.float64).tolist():
        # the first cut above the budget
        above = int(np.searchsorted(level_count, budget, side="right"))
        values = at_level(above - 1)
        if above < len(level):
            spent = float(level_count[above - 1]) if above else 0.0
            share = (budget - spent) / (float(level_count[above]) - spent)
            values = (1.0 - share) * values + share * at_level(above)
        budget_values.append(values)
    return np.stack(budget_values)


def fixed_parts(
    cuts: Cuts, malformed: Ints, miss_error: Floats, truth_complete: bool
) -> tuple[Floats, Floats, float, float]:
    """Return the parts of the error at the fixed operating point, c-GOSPA, m.

    The parts: the error of each target [n], the share of it from targets without a
    forecast, the cost of false forecasts, the cost of invalid objects. Errors of
    targets and both costs add up to the error.

    A target costs min(minADE, c), and c without a forecast of confidence 0.5 or more. A
    false forecast of such a confidence costs c / 2; if false ones are unknown, each
    beyond the 40 most confident of a frame does.

    ``cuts``: the forecasts of live frames. ``malformed`` [F, C + 1]: invalid objects in
    live frames by class; they count as false forecasts, those without a class as of the
    largest c. ``miss_error`` [C]: c.
    """
    error, missed = cuts.at(FIXED_CONFIDENCE)
    class_cost = FALSE_FORECAST_SHARE * np.append(miss_error, miss_error.max())
    malformed_cost = malformed @ class_cost  # [F]
    if truth_complete:
        false_cost = cuts.false_costs(FIXED_CONFIDENCE, class_cost)
        return error, missed, false_cost, float(malformed_cost.sum())
    row = np.flatnonzero(cuts.confidence >= FIXED_CONFIDENCE)
    frame = cuts.frame[row]
    order = np.argsort(frame, kind="stable")  # by frame, then the most confident first
    rank_in_frame = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    beyond = row[order[rank_in_frame >= FREE_FORECASTS]]
    false_cost = float(class_cost[cuts.class_id[beyond]].sum())
    frame_count = np.bincount(frame, minlength=len(malformed))
    # invalid objects come last: a frame's share of them beyond the free ones costs
    free = np.maximum(0, FREE_FORECASTS - frame_count)
    invalid = malformed.sum(axis=1)
    share = np.zeros(len(invalid))
    np.divide(np.maximum(0, invalid - free), invalid, out=share, where=invalid > 0)
    return error, missed, false_cost, float((share * malformed_cost).sum())
