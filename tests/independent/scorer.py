"""All numbers of one agent, and the comparison of several; see the package for the sentences behind each function."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.types import Floats, Rollout, Scene

from . import shown
from .budgets import at_budgets, budgets_of, cuts
from .forecasts import Run
from .statistics import (
    Drawn,
    Interval,
    drawn_signs,
    drawn_units,
    effective,
    guarded,
    of_shares,
    sign_flip,
    studentised,
    sums_of,
    units_of,
    why_unranked,
)
from .targets import Target, find_targets

Row = dict[str, Any]
BESIDE = (
    "difference_to_stp", "difference_interval", "p", "gap_closed", "gap_interval", "gap_closed_same_predictor",
    "gap_same_predictor_interval",
)  # fmt: skip


class Ends(NamedTuple):
    """Names of the agents between which a gap is closed."""

    stp: str
    true_pasts: str


class Draws(NamedTuple):
    """Random draws for n units."""

    units: Drawn
    signs: Drawn


KINEMATIC = Ends("stp", "gt")
OWN_DRAWS = Draws(drawn_units, drawn_signs)


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
    units = units_of(scenes, targets, card)
    subsets = {"all": np.ones(len(targets)), **(weights or {})}
    runs = [Run(card, scenes, targets, rollouts) for rollouts in seeds]
    walked = [list(cuts(run)) for run in runs]
    errors: dict[str, Floats] = {}
    rows: dict[str, Row] = {}
    of_runs = [_of_run(run) for run in runs] if targets else []
    for name, w in subsets.items():
        parts = [at_budgets(steps, budgets_of(run, reference, name)) for run, steps in zip(runs, walked, strict=True)]
        errors[name] = np.mean([error for part in parts for error, _ in part], axis=0)
        missed = np.mean([missed for part in parts for _, missed in part], axis=0)
        rows[name] = _counts(targets, w, units) | {
            "error": _mean(w, errors[name]),
            "localisation": _mean(w, errors[name] - missed),
            "missed": _mean(w, missed),
            **_over_seeds([_of_subset(numbers, w) for numbers in of_runs]),
        }
    rows["all"] |= _over_seeds([numbers["run"] for numbers in of_runs])
    return Scored(targets, units, dict(subsets), errors, rows)


def compare(
    scored: Mapping[str, Scored],
    ends: Ends = KINEMATIC,
    own_ends: Mapping[str, tuple[Scored, Scored] | None] | None = None,
    free: Collection[str] = (),
    draws: Draws = OWN_DRAWS,
) -> dict[str, dict[str, Row]]:
    """Rank, differences, gaps closed and their intervals, by subset and agent.

    ``own_ends``: of an agent, STP and true pasts with its own predictor; None: those of ``ends``. ``free``: agents of
    more samples than k, which share no column with the others.

    Reading: true pasts and free rows are compared and do not take a rank; only agents that have a rank count as better.
    """
    everyone, own = dict(scored), dict[str, Ends]()
    for name, pair in (own_ends or {}).items():
        own[name] = Ends(f"{name}, stp", f"{name}, true pasts") if pair else ends
        everyone |= dict(zip(own[name], pair, strict=True)) if pair else {}
    result: dict[str, dict[str, Row]] = {}
    for subset in scored[ends.stp].weights:
        paired = Paired(everyone, subset, draws)
        if not paired.weight.sum() > 0:
            result[subset] = {}
            continue
        reason = {
            name: "more samples than k"
            if name in free
            else "true pasts"
            if name == ends.true_pasts
            else _why_unranked(everyone, subset, name, ends.stp, own[name].stp if name in own else None)
            for name in scored
        }
        ranked = [name for name in scored if not reason[name]]
        result[subset] = {
            name: {
                "interval": paired.interval(paired.sums[name]),
                "rank": None if reason[name] else 1 + sum(paired.better(other, name) for other in ranked),
                "unranked_because": reason[name],
                **(dict.fromkeys(BESIDE) if name in free else _beside(paired, name, ends, own.get(name))),
            }
            for name in scored
        }
    return result


def _beside(paired: Paired, name: str, ends: Ends, own: Ends | None) -> Row:
    gap, interval = (None, None) if own not in (None, ends) else paired.gap(name, ends)  # another predictor
    return {
        "difference_to_stp": paired.difference(name, ends.stp),
        "difference_interval": paired.interval(paired.less(name, ends.stp)),
        "p": paired.p(name, ends.stp),
        "gap_closed": gap,
        "gap_interval": interval,
        "gap_closed_same_predictor": paired.gap(name, own)[0] if own else None,
        "gap_same_predictor_interval": paired.gap(name, own)[1] if own else None,
    }


class Paired:
    """Agents side by side on a subset, unit by unit."""

    def __init__(self, scored: Mapping[str, Scored], subset: str, draws: Draws) -> None:
        one = next(iter(scored.values()))
        self.weight = np.array(sums_of(one.units, one.weights[subset]))
        self.sums: dict[str, Floats] = {
            name: np.array(sums_of(agent.units, agent.weights[subset] * agent.errors[subset]))
            for name, agent in scored.items()
        }
        self.draws = draws

    def less(self, a: str, b: str) -> Floats:
        """d_u of every unit."""
        a_u, b_u = self.sums[a], self.sums[b]
        return a_u - b_u

    def difference(self, a: str, b: str) -> float:
        return float(self.less(a, b).sum() / self.weight.sum())

    def p(self, a: str, b: str) -> float:
        return sign_flip(self.less(a, b).tolist(), self.draws.signs)

    def better(self, a: str, b: str) -> bool:
        return self.difference(a, b) < 0 and self.p(a, b) < 0.05

    def interval(self, sums: Floats) -> Interval | None:
        return studentised(sums, self.weight, self.draws.units)

    def gap(self, name: str, ends: Ends) -> tuple[float | None, Interval | None]:
        """The gap closed and its interval.

        Reading: "significantly above 0" is an interval above 0, which says something below 6 units too; a sign-flip
        test cannot.
        """
        if ends.true_pasts not in self.sums:
            return None, None
        won, whole = self.less(ends.stp, name), self.less(ends.stp, ends.true_pasts)
        interval = self.interval(whole)
        if interval is None or interval[0] <= 0:
            return None, None
        return float(won.sum() / whole.sum()), of_shares(won, whole, self.draws.units)


def _why_unranked(scored: Mapping[str, Scored], subset: str, name: str, stp: str, own_stp: str | None) -> str:
    """Why an agent with k samples that did not see the truth has no rank; empty where it has."""
    kept = scored[stp]
    if reason := why_unranked(subset, kept.weights[subset], kept.units, [g.owner for g in kept.targets]):
        return reason
    of_all = {each: scored[each].rows["all"]["error"] for each in (name, stp, own_stp) if each is not None}
    worse = guarded(subset, of_all[name], of_all[stp], of_all[own_stp] if own_stp else None)
    return "worse than STP on all" if worse else ""


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


def _counts(targets: Sequence[Target], w: Floats, units: Sequence[tuple[int, int]]) -> Row:
    there = [g for g, weight in zip(targets, w, strict=True) if weight > 0]
    return {
        "targets": len(there),
        "effective_targets": effective([float(x) for x in w]),
        "effective_objects": effective(sums_of([g.owner for g in targets], w)),
        "effective_units": effective(sums_of(units, w)),
        "objects": len({g.owner for g in there}),
        "scenes": len({g.scene for g in there}),
    }


def _mean(w: Floats, values: Floats) -> float | None:
    return float((w * values).sum() / w.sum()) if w.sum() > 0 else None


def _over_seeds(rows: Sequence[Row]) -> Row:
    names = rows[0] if rows else {}
    known = {name: [row[name] for row in rows if row[name] is not None] for name in names}
    return {name: np.mean(values, axis=0) if values else None for name, values in known.items()}
