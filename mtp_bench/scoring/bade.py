"""Budgeted ADE (bADE) and its relatives: errors of targets at confidence thresholds (docs/definitions, "bADE").

| number | forecasts that are kept |
|---|---|
| plain error | all |
| fixed error | those of a confidence of at least 0.5; false ones cost c / 2 |
| bADE | as many as a budget of false forecasts allows, averaged over budgets |

A cut is a confidence threshold: it keeps the forecasts of at least that confidence. The error at a budget is that of
the last cut within it; the rest of the budget counts as a share of the next cut.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints
from .definitions import (
    BUDGETS,
    FALSE_FORECAST_SHARE,
    FORECASTS_PER_FRAME,
    FREE_FORECASTS,
    SURE,
)
from .incremental_matching import last_of
from .pairs import Rows


@dataclass(frozen=True, eq=False)
class Cuts:
    """The A forecasts in live frames by falling confidence, and the E changes of errors as they are added in turn."""

    confidence: Floats  # [A] falling
    frame: Ints  # [A]
    class_id: Ints  # [A]
    false: Bools  # [A] adding it makes one more false forecast
    step: Rows  # [E] the forecast whose addition changes an error, rising
    target: Rows  # [E] the target whose error changes
    error: Floats  # [E] m, of the target from then on, at most c
    covered: Bools  # [E] True if the target has a forecast from then on
    miss_error: Floats  # [n] m, c of each target

    def at(self, least: float) -> tuple[Floats, Floats]:
        """Error of each target [n], m, and its part from targets without a forecast, at the least kept confidence."""
        kept = int(np.searchsorted(-self.confidence, -least, side="right"))
        changes = int(np.searchsorted(self.step, kept))
        error, missed = self.miss_error.copy(), self.miss_error.copy()
        last = last_of(self.target[:changes])
        target = self.target[last]
        error[target] = self.error[last]
        missed[target[self.covered[last]]] = 0.0
        return error, missed

    def false_costs(self, least: float, cost: Floats) -> float:
        """Sum of ``cost`` [C] by class over the false forecasts of confidence ``least`` and more."""
        return float(cost[self.class_id[self.false & (self.confidence >= least)]].sum())


@dataclass(frozen=True, eq=False)
class Budgets:
    """Numbers of false forecasts that are allowed; if false ones are unknown, forecasts per live frame."""

    all: Floats  # bADE of "all" is the mean over these
    subsets: float  # of the event subsets
    false_known: bool = True


@dataclass(frozen=True)
class CardBudget:
    """Constants of a card that set its budgets: counts of the reference STP on the scored split.

    Budgets never depend on what an agent is given: worse detections would widen them, and lower its error.
    """

    env: str = ""  # id of the card; empty: its scored split has no frozen counts
    forecasts: int = 1  # false ones of STP; all of them if false ones are unknown
    divisor: int = 1  # targets; live frames if false forecasts are unknown
    false_known: bool = (
        True  # False: the truth of the scored split holds prediction targets alone
    )

    def fit_for(self, false_known: bool) -> "CardBudget":
        """Return the constants for scenes whose false forecasts are known or not; without such, one per target."""
        return (
            self
            if self.false_known == false_known
            else CardBudget(false_known=false_known)
        )

    def budgets(self, targets: int, false_known: bool = True) -> Budgets:
        """Return the budgets of a run with this number of targets.

        ``false_known``: False where the truth of the run's scenes holds prediction targets alone.
        """
        own = self.fit_for(false_known)
        if false_known:
            limit = (
                own.forecasts * targets / own.divisor
            )  # multiplied first: exact on the scored split
            return Budgets(
                np.arange(1, BUDGETS + 1) * min(float(targets), limit) / BUDGETS, limit
            )
        per_frame = [
            *FORECASTS_PER_FRAME,
            *([own.forecasts / own.divisor] if own.env else []),
        ]
        return Budgets(np.array(per_frame), per_frame[-1], false_known=False)

    def text(self, false_known: bool = True) -> str:
        """Return the budgets of a run and their source in words, for a report."""
        own = self.fit_for(false_known)
        source = f"constant of {own.env}" if own.env else "no constant for such scenes"
        if not false_known:
            rates = ", ".join(f"{rate:.3g}" for rate in own.budgets(0, false_known).all)
            return f"{rates} forecasts per live frame, as false ones are not known ({source})"
        rate = own.forecasts / own.divisor
        most = ", over all targets up to 1" if rate > 1 else ""
        return f"up to {rate:.3g} per target{most} ({source})"


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
    """Errors of one run, the ``cuts`` of all its scenes, at each of the ``budgets``.

    ``live_frames``: of the run, if a budget is a number of forecasts per live frame; None: of false forecasts.
    """
    both = at_budgets(
        cuts, budgets, lambda scene, least: np.stack(cuts[scene].at(least)), live_frames
    )
    return BudgetErrors(both[:, 0], both[:, 1])


def at_budgets(
    cuts: Sequence[Cuts],
    budgets: Sequence[float] | Floats,
    value: Callable[[int, float], Floats],
    live_frames: int | None = None,
) -> Floats:
    """Values of targets at each of the ``budgets`` [b, p, n], interpolated between two cuts.

    ``value(scene, least)``: p values [p, targets] of the scene of this index, for the least kept confidence ``least``.
    """
    confidence = np.concatenate([cut.confidence for cut in cuts])
    false = np.concatenate([cut.false for cut in cuts])
    order = np.argsort(-confidence, kind="stable")
    level, first = np.unique(-confidence[order], return_index=True)
    last = np.append(first[1:], len(confidence)) - 1 if len(level) else first
    count = (
        np.cumsum(false[order])
        if live_frames is None
        else np.arange(1, len(order) + 1) / max(live_frames, 1)
    )
    computed: dict[int, Floats] = {}

    def at(cut: int) -> Floats:
        """Values at the cut whose least confidence is level ``cut``; -1 keeps no forecast."""
        if cut not in computed:
            least = -float(level[cut]) if cut >= 0 else np.inf
            computed[cut] = np.concatenate(
                [value(scene, least) for scene in range(len(cuts))], axis=1
            )
        return computed[cut]

    reached = count[last] if len(level) else np.zeros(0)
    rows = []
    for budget in np.asarray(budgets, dtype=np.float64).tolist():
        beyond = int(
            np.searchsorted(reached, budget, side="right")
        )  # the first cut above the budget
        row = at(beyond - 1)
        if beyond < len(level):
            before = float(reached[beyond - 1]) if beyond else 0.0
            share = (budget - before) / (float(reached[beyond]) - before)
            row = (1.0 - share) * row + share * at(beyond)
        rows.append(row)
    return np.stack(rows)


def capped_error(min_ade: Floats, miss_error: Floats) -> Floats:
    """Error [n] of targets, m: ``min_ade`` [n], inf without a forecast, at most ``miss_error`` [n]."""
    return np.minimum(min_ade, miss_error)


def fixed_error(
    cuts: Cuts, malformed: Ints, miss_error: Floats, truth_complete: bool
) -> float:
    """Error at the fixed operating point, summed over the targets of a scene, m: c-GOSPA.

    A target costs min(minADE, c), and c without a forecast of confidence 0.5 or more. A false forecast of such a
    confidence costs c / 2; if false ones are unknown, each beyond the 40 most confident of a frame does.

    ``cuts``: the forecasts of live frames. ``malformed`` [F, C + 1]: invalid objects in live frames by class; they
    count as false forecasts, those without a class as of the largest c. ``miss_error`` [C]: c.
    """
    error, _, false, broken = fixed_parts(cuts, malformed, miss_error, truth_complete)
    return float(error.sum()) + false + broken


def fixed_parts(
    cuts: Cuts, malformed: Ints, miss_error: Floats, truth_complete: bool
) -> tuple[Floats, Floats, float, float]:
    """Parts of `fixed_error`, whose arguments it has, m.

    They are the error of each target [n], its part from targets without a forecast, the cost of the false forecasts,
    and that of the invalid objects.
    """
    error, missed = cuts.at(SURE)
    share = FALSE_FORECAST_SHARE * np.append(miss_error, miss_error.max())
    broken = malformed @ share
    if truth_complete:
        return error, missed, cuts.false_costs(SURE, share), float(broken.sum())
    kept = np.flatnonzero(cuts.confidence >= SURE)
    frame = cuts.frame[kept]
    order = np.argsort(frame, kind="stable")  # by frame, then the most confident first
    place = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    beyond = kept[order[place >= FREE_FORECASTS]]
    free = np.maximum(0, FREE_FORECASTS - np.bincount(frame, minlength=len(malformed)))
    count = malformed.sum(axis=1)
    part = np.divide(
        np.maximum(0, count - free), count, out=np.zeros(len(count)), where=count > 0
    )
    return (
        error,
        missed,
        float(share[cuts.class_id[beyond]].sum()),
        float((part * broken).sum()),
    )
