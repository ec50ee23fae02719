"""The error at false-forecast budgets: the number that ranks (protocol, "error at false-forecast budgets").

A cut keeps the forecasts of at least some confidence. The sharper the cut, the fewer false forecasts and the more
targets without one. A budget allows a number of false forecasts; the error at it is that of the last cut which keeps
within it, with the rest of the budget spent on a share of the next cut.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Floats
from .cuts import Cuts
from .definitions import BUDGETS, FORECASTS_PER_FRAME


@dataclass(frozen=True, eq=False)
class Budgets:
    """How many false forecasts are allowed; where false ones are not known, how many forecasts per live frame."""

    all: Floats  # the mean over these ranks "all"
    subsets: float  # ranks the subsets: STP's own number
    false_known: bool = True


@dataclass(frozen=True, eq=False)
class BudgetErrors:
    """Errors of one run, per budget b and target."""

    error: Floats  # [b, n] m
    missed: Floats  # [b, n] m, the part that targets without a forecast make


def budgets_of(targets: int, stp: float, false_known: bool = True) -> Budgets:
    """The budgets of a run with this number of targets.

    ``stp``: the false forecasts of the reference STP in the same scenes; where false ones are not known, its forecasts
    per live frame. Without a limit of STP it is inf.
    """
    if false_known:
        return Budgets(np.arange(1, BUDGETS + 1) * min(float(targets), stp) / BUDGETS, stp)
    return Budgets(np.array([*FORECASTS_PER_FRAME, *([stp] if np.isfinite(stp) else [])]), stp, false_known=False)


def errors_at(cuts: Sequence[Cuts], budgets: Sequence[float] | Floats, live_frames: int | None = None) -> BudgetErrors:
    """Errors of one run, the ``cuts`` of all its scenes, at each of the ``budgets``.

    ``live_frames``: of the run, where a budget is a number of forecasts per live frame; None: of false forecasts.
    """
    both = at_budgets(cuts, budgets, lambda scene, least: np.stack(cuts[scene].at(least)), live_frames)
    return BudgetErrors(both[:, 0], both[:, 1])


def at_budgets(
    cuts: Sequence[Cuts],
    budgets: Sequence[float] | Floats,
    value: Callable[[int, float], Floats],
    live_frames: int | None = None,
) -> Floats:
    """What is known of targets at cuts, taken at each of the ``budgets``: [b, p, n].

    ``value(scene, least)``: p values [p, targets] of the scene of this place, where the least confidence that is kept
    is ``least``. The last cut within a budget counts, and the next one with the share that the rest of the budget pays.
    """
    confidence = np.concatenate([cut.confidence for cut in cuts])
    false = np.concatenate([cut.false for cut in cuts])
    order = np.argsort(-confidence, kind="stable")
    level, first = np.unique(-confidence[order], return_index=True)
    last = np.append(first[1:], len(confidence)) - 1 if len(level) else first
    count = np.cumsum(false[order]) if live_frames is None else np.arange(1, len(order) + 1) / max(live_frames, 1)
    known: dict[int, Floats] = {}

    def at(cut: int) -> Floats:
        """Values at a cut, the least confidence of which is level ``cut``; -1 keeps nothing."""
        if cut not in known:
            least = -float(level[cut]) if cut >= 0 else np.inf
            known[cut] = np.concatenate([value(scene, least) for scene in range(len(cuts))], axis=1)
        return known[cut]

    reached = count[last] if len(level) else np.zeros(0)
    rows = []
    for budget in np.asarray(budgets, dtype=np.float64).tolist():
        beyond = int(np.searchsorted(reached, budget, side="right"))  # the first cut that exceeds it
        low = at(beyond - 1)
        if beyond < len(level):
            before = float(reached[beyond - 1]) if beyond else 0.0
            share = (budget - before) / (float(reached[beyond]) - before)
            low = (1.0 - share) * low + share * at(beyond)
        rows.append(low)
    return np.stack(rows)
