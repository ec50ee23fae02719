"""bADE, the error averaged over false-forecast budgets."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mtp_bench.core import Bools, Floats

from .forecasts import Run, judge_frame


@dataclass(frozen=True, eq=False)
class Cut:
    """The run with the forecasts of a least confidence only."""

    least: float
    false: int  # F_j
    error: Floats  # [n] min(minADE, c), or c
    missed: Bools  # [n]


def cuts(run: Run) -> Iterator[Cut]:
    """Cut 0, which keeps nothing, then one per distinct confidence of the run, downwards.

    Frames where nothing is added by a cut keep their matching, which would be the same.
    """
    c = np.array([run.miss_errors[target.kind] for target in run.targets], dtype=float)
    error, missed, false = c.copy(), np.ones(len(c), dtype=bool), dict.fromkeys(run.frames(), 0)
    yield Cut(np.inf, 0, error.copy(), missed.copy())
    touched: dict[float, set[tuple[int, int]]] = {}
    for s, t in run.frames():
        for r in run.rows(s, t):
            touched.setdefault(float(run.rollouts[s].object_confidence[r]), set()).add((s, t))
    asked: dict[tuple[int, int], list[int]] = {}
    for i, target in enumerate(run.targets):
        asked.setdefault((target.scene, target.t), []).append(i)
    for least in sorted(touched, reverse=True):
        for s, t in touched[least]:
            rows = run.rows(s, t, least)
            verdict = judge_frame(run, s, t, least)
            false[s, t] = len(verdict.false) if run.complete else len(rows)
            for i in asked.get((s, t), ()):
                error[i], missed[i] = c[i], True
            for r, g in verdict.matched.items():
                if (s, g) in run.index:
                    i = run.index[s, g]
                    error[i], missed[i] = min(run.against(s, r, g).min_ade, c[i]), False
        yield Cut(least, sum(false.values()), error.copy(), missed.copy())


def budgets_of(run: Run, constants: tuple[int, int], subset: str) -> list[float]:
    """Budgets of a subset, in false forecasts of the run.

    ``constants``: F_ref and n_ref of the card; where the truth is incomplete STP's forecasts and live frames there, and
    the budgets are numbers of forecasts in live frames, right or wrong. E(B) jumps where B meets a count, so a budget
    that is whole but for rounding is made whole.
    """
    stated, of = constants
    if run.complete:
        own = stated * len(run.targets) / of
        budgets = [j * min(len(run.targets), own) / 10 for j in range(1, 11)] if subset == "all" else [own]
    else:
        own = stated / of
        budgets = [n * len(run.frames()) for n in ((20.0, 40.0, own) if subset == "all" else (own,))]
    return [float(round(b)) if abs(b - round(b)) < 1e-9 * max(1.0, b) else float(b) for b in budgets]


def shares_at(steps: Sequence[Cut], budgets: Sequence[float]) -> list[tuple[float, Cut]]:
    """Cuts of a run and their shares, which sum to 1, in a number that is averaged over the budgets."""
    shares: list[tuple[float, Cut]] = []
    for budget in budgets:
        over = next((j for j, cut in enumerate(steps) if cut.false > budget), None)
        if over is None:
            shares.append((1 / len(budgets), steps[-1]))
        else:
            last, following = steps[over - 1], steps[over]
            l = (budget - last.false) / (following.false - last.false)
            shares += [((1 - l) / len(budgets), last), (l / len(budgets), following)]
    return shares


def error_at(steps: Sequence[Cut], budgets: Sequence[float]) -> Floats:
    """Error of each target [n], averaged over the budgets."""
    return np.array(sum(share * cut.error for share, cut in shares_at(steps, budgets)))
