"""All numbers of one agent, and the comparison of several; see the package for the sentences behind each function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.types import Floats, Rollout, Scene

from . import shown
from .budgets import at_budgets, budgets_of
from .forecasts import Run
from .statistics import effective, guarded, sign_flip, sums_of, units_of, why_unranked
from .targets import Target, find_targets

Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Scored:
    """An agent on all scenes, over its seeds."""

    targets: list[Target]
    units: list[tuple[int, int]]  # of each target
    weights: dict[str, Floats]  # [n] of each subset
    errors: dict[str, Floats]  # [n] of each subset, averaged over budgets and seeds: what ranks
    rows: dict[str, Row]  # of each subset


def score(
    card: Card,
    scenes: Sequence[Scene],
    seeds: Sequence[Sequence[Rollout]],
    reference: float,
    weights: Mapping[str, Floats] | None = None,
) -> Scored:
    """Score the rollouts of each seed; ``weights``: of each event subset per target, in the order of `find_targets`.

    Reading: every number is computed per seed and averaged over the seeds that have it.
    """
    targets = find_targets(scenes, card)
    subsets = {"all": np.ones(len(targets)), **(weights or {})}
    runs = [Run(card, scenes, targets, rollouts) for rollouts in seeds]
    errors: dict[str, Floats] = {}
    rows: dict[str, Row] = {}
    of_runs = [_of_run(run) for run in runs] if targets else []
    for name, w in subsets.items():
        parts = [at_budgets(run, budgets_of(run, reference, name)) for run in runs]
        errors[name] = np.mean([error for part in parts for error, _ in part], axis=0)
        missed = np.mean([missed for part in parts for _, missed in part], axis=0)
        rows[name] = _counts(targets, w) | {
            "error": _mean(w, errors[name]),
            "localisation": _mean(w, errors[name] - missed),
            "missed": _mean(w, missed),
            **_over_seeds([_of_subset(numbers, w) for numbers in of_runs]),
        }
    rows["all"] |= _over_seeds([numbers["run"] for numbers in of_runs])
    return Scored(targets, units_of(scenes, targets, card), dict(subsets), errors, rows)


def compare(
    scored: Mapping[str, Scored], stp: str = "stp", true_pasts: str = "gt", own_ends: Mapping[str, str] | None = None
) -> dict[str, dict[str, Row]]:
    """Rank, difference to STP, its p, and the gap closed, by subset and agent.

    ``own_ends``: for an agent, who is STP with its own predictor. Reading: the row of true pasts is compared and does
    not take a rank; only agents that have a rank count as better; the gap needs a two-sided p below .05.
    """
    result: dict[str, dict[str, Row]] = {}
    for subset in scored[stp].weights:
        error = {name: agent.rows[subset]["error"] for name, agent in scored.items()}
        if error[stp] is None:
            result[subset] = {}
            continue
        test = _tester(scored, subset)
        everywhere = {name: agent.rows["all"]["error"] for name, agent in scored.items()}
        kept = scored[stp]
        reason = why_unranked(subset, kept.weights[subset], kept.units, [g.owner for g in kept.targets])
        ranked = [
            name
            for name in scored
            if not reason
            and name != true_pasts
            and not guarded(subset, everywhere[name], everywhere[stp], everywhere.get((own_ends or {}).get(name, "")))
        ]
        open_gap = true_pasts in scored and test(true_pasts, stp)[0] < 0 and test(true_pasts, stp)[1] < 0.05
        result[subset] = {
            name: {
                "difference_to_stp": error[name] - error[stp],
                "p": test(name, stp)[1],
                "rank": 1 + sum(test(b, name)[0] < 0 and test(b, name)[1] < 0.05 for b in ranked if b != name)
                if name in ranked
                else None,
                "gap_closed": (error[stp] - error[name]) / (error[stp] - error[true_pasts]) if open_gap else None,
            }
            for name in scored
        }
    return result


def _tester(scored: Mapping[str, Scored], subset: str) -> Callable[[str, str], tuple[float, float]]:
    """Sum of d_u of two agents, and its p."""

    def test(a: str, b: str) -> tuple[float, float]:
        w = scored[a].weights[subset]
        d = sums_of(scored[a].units, w * (scored[a].errors[subset] - scored[b].errors[subset]))
        return sum(d), sign_flip(d)

    return test


def _of_run(run: Run) -> Row:
    """Arrays per target [n] with 0 where missing, and numbers of the whole run under "run"."""
    found = shown.of_targets(run)
    covered = np.array([x is not None for x in found], dtype=bool)
    plain = shown.plain_errors(run)
    samples = max([1, *(rollout.forecast.shape[1] for rollout in run.rollouts)])
    arrays = {
        "minADE": np.array([0.0 if x is None else x.min_ade for x in found]),
        "minFDE": np.array([0.0 if x is None else x.min_fde for x in found]),
        "energy_score": np.array([0.0 if x is None else x.energy for x in found]),
    }
    curves = [[x.curve[min(k, len(x.curve)) - 1] for k in range(1, samples + 1)] for x in found if x and x.curve]
    whole = {
        "fixed_error": shown.fixed_error(run),
        "brier": shown.brier(run) if run.complete else None,
        "false_per_frame": shown.false_per_frame(run) if run.complete else None,
        "pi_ade": shown.planning_aware(run, arrays["minADE"], covered),
        "pi_ade_all_targets": shown.planning_aware(run, plain, np.ones(len(plain), dtype=bool)),
        "epa": shown.epa(run) if run.complete else None,
        "ap_f": shown.ap_f(run) if run.complete else None,
        "k_curve": np.mean(curves, axis=0) if curves else None,
    }
    miss = np.array([x is None or x.miss for x in found], dtype=float)
    return {"arrays": arrays, "covered": covered, "plain": plain, "miss": miss, "run": whole}


def _of_subset(numbers: Row, w: Floats) -> Row:
    """Means of one run over a subset; errors over the targets that are covered."""
    on_covered = {name: _mean(w * numbers["covered"], values) for name, values in numbers["arrays"].items()}
    return on_covered | {
        "plain_error": _mean(w, numbers["plain"]),
        "coverage": _mean(w, numbers["covered"].astype(float)),
        "MR": _mean(w, numbers["miss"]),
    }


def _counts(targets: Sequence[Target], w: Floats) -> Row:
    there = [g for g, weight in zip(targets, w, strict=True) if weight > 0]
    return {
        "targets": len(there),
        "effective_targets": effective([float(x) for x in w]),
        "objects": len({g.owner for g in there}),
        "scenes": len({g.scene for g in there}),
    }


def _mean(w: Floats, values: Floats) -> float | None:
    return float((w * values).sum() / w.sum()) if w.sum() > 0 else None


def _over_seeds(rows: Sequence[Row]) -> Row:
    names = rows[0] if rows else {}
    known = {name: [row[name] for row in rows if row[name] is not None] for name in names}
    return {name: np.mean(values, axis=0) if values else None for name, values in known.items()}
