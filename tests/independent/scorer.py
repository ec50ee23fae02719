"""All numbers of one agent, and the comparison of several; see the package for the sentences behind each function."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.core import Floats, Rollout, Scene

from . import shown, statistics
from .budgets import budgets_of, cuts, error_at
from .forecasts import Run
from .parts import ABSENT, COVERED, Known, covered_errors, parts_at
from .statistics import Drawn, Interval, sums_of
from .targets import Target, find_targets

Row = dict[str, Any]
BESIDE = (
    "difference_to_stp", "difference_interval", "p", "gap_closed", "gap_interval", "gap_closed_same_predictor",
    "gap_same_predictor_interval", "association_gap_closed", "association_gap_interval",
)  # fmt: skip


class Own(NamedTuple):
    """References with the predictor of an agent; None: there is no such run."""

    stp: Scored | None = None
    true_pasts: Scored | None = None
    same_samples: Scored | None = None
    associated_same_samples: Scored | None = None


class Draws(NamedTuple):
    """Random draws for n units."""

    units: Drawn
    signs: Drawn


STP, TRUE_PASTS = "stp", "gt"  # names of the references with the kinematic predictor
OWN_DRAWS = Draws(statistics.drawn_units, statistics.drawn_signs)


@dataclass(frozen=True, eq=False)
class Scored:
    """An agent on all scenes, over its seeds."""

    targets: list[Target]
    units: list[tuple[int, int]]  # of each target
    weights: dict[str, Floats]  # [n] of each subset
    errors: dict[str, Floats]  # [n] of each subset, averaged over budgets and seeds: bADE
    rows: dict[str, Row]  # of each subset
    covered: tuple[Floats, Floats]  # [n] error with every forecast kept, and with the present place moved to the truth


def score(
    card: Card, scenes: Sequence[Scene], seeds: Sequence[Sequence[Rollout]], constants: tuple[int, int],
    weights: Mapping[str, Floats] | None = None, known: tuple[Scored, Scored] | None = None,
) -> Scored:  # fmt: skip
    """Score the rollouts of each seed; ``weights``: of each event subset per target, in the order of `find_targets`.

    ``constants``: F_ref and n_ref of the card, see `budgets_of`.
    ``known``: perfect association and ground-truth tracks with the predictor of the agent, for the parts of its error.
    Reading: every number is computed per seed and averaged over the seeds that have it.
    """
    targets = find_targets(scenes, card)
    units = statistics.units_of(scenes, targets, card)
    subsets = {"all": np.ones(len(targets)), **(weights or {})}
    runs = [Run(card, scenes, targets, rollouts) for rollouts in seeds]
    walked = [list(cuts(run)) for run in runs]
    errors: dict[str, Floats] = {}
    rows: dict[str, Row] = {}
    of_runs = [_of_run(run) for run in runs] if targets else []
    references = Known(*known[0].covered, known[1].covered[0]) if known else None
    for name, w in subsets.items():
        budgets = [budgets_of(run, constants, name) for run in runs]
        at = list(zip(runs, walked, budgets, strict=True))
        errors[name] = np.mean([error_at(steps, b) for _, steps, b in at], axis=0)
        parts = [parts_at(run, steps, b, references) for run, steps, b in at]
        costs = {part: _mean(w, np.mean([each[part] for each in parts], axis=0)) for part in parts[0]}
        rows[name] = _counts(targets, w, units) | {
            "error": _mean(w, errors[name]),
            "localisation": _total(costs, COVERED),
            "missed": _total(costs, ABSENT),
            **{f"cost_{part}": costs.get(part) for part in ABSENT + COVERED},
            **_over_seeds([_of_subset(numbers, w) for numbers in of_runs]),
        }
    rows["all"] |= _over_seeds([numbers["run"] for numbers in of_runs])
    return Scored(targets, units, dict(subsets), errors, rows, covered_errors(runs))


def compare(
    scored: Mapping[str, Scored], own: Mapping[str, Own] | None = None, free: Collection[str] = (),
    draws: Draws = OWN_DRAWS,
) -> dict[str, dict[str, Row]]:  # fmt: skip
    """Place, range of ranks, differences, gaps closed and their intervals, by subset and agent.

    ``own``: of an agent, the references with its own predictor. ``free``: agents of more than k samples, which share no
    column with the others.

    Reading: true pasts and free rows do not take a rank; only agents that have one count as better or worse.
    """
    everyone = dict(scored)
    for name, references in (own or {}).items():
        everyone |= {f"{name}, {role}": run for role, run in references._asdict().items() if run}
    learned = [name for name, references in (own or {}).items() if references.stp is not scored[STP]]
    result: dict[str, dict[str, Row]] = {}
    for subset in scored[STP].weights:
        paired = Paired(everyone, subset, draws)
        if not paired.weight.sum() > 0:
            result[subset] = {}
            continue
        reason = {
            name: "more samples than k"
            if name in free
            else "true pasts"
            if name == TRUE_PASTS
            else _why_unranked(everyone, subset, name, draws)
            for name in scored
        }
        ranked = [name for name in scored if not reason[name]]
        result[subset] = {
            name: {
                "interval": paired.interval(name),
                "place": None if reason[name] else 1 + sum(paired.difference(r, name) < -1e-12 for r in ranked),
                "rank_range": None if reason[name] else paired.range(name, ranked),
                "unranked_because": reason[name],
                **(dict.fromkeys(BESIDE) if name in free else _beside(paired, name, name in learned)),
            }
            for name in scored
        }
    return result


def _beside(paired: Paired, name: str, learned: bool) -> Row:
    """``learned``: the predictor is not the kinematic one, so the share between kinematic ends is left empty."""
    shares = (
        *((None, None) if learned else paired.gap(name, STP, TRUE_PASTS)),
        *paired.gap(name, f"{name}, stp", f"{name}, true_pasts"),
        *paired.gap(name, f"{name}, same_samples", f"{name}, associated_same_samples"),
    )
    difference = paired.difference(name, STP), paired.difference_interval(name, STP), paired.p(name, STP)
    return dict(zip(BESIDE, (*difference, *shares), strict=True))


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
        return statistics.sign_flip(self.less(a, b), self.weight, self.draws.signs)

    def difference_interval(self, a: str, b: str) -> Interval | None:
        return statistics.inverted(self.less(a, b), self.weight, self.draws.signs)

    def better(self, a: str, b: str) -> bool:
        return self.difference(a, b) < 0 and self.p(a, b) < 0.05

    def range(self, name: str, ranked: Sequence[str]) -> tuple[int, int]:
        """Ranks that an agent may have."""
        better = sum(self.better(other, name) for other in ranked)
        return 1 + better, len(ranked) - sum(self.better(name, other) for other in ranked)

    def interval(self, name: str) -> Interval | None:
        """Interval of an error, which is never below 0."""
        found = statistics.studentised(self.sums[name], self.weight, self.draws.units)
        return found and (max(0.0, found[0]), max(0.0, found[1]))

    def gap(self, name: str, worse: str, best: str) -> tuple[float | None, Interval | None]:
        """Share of the gap that is closed, and its interval; missing unless the gap is significantly above 0."""
        if not {worse, best} <= self.sums.keys() or not self.better(best, worse):
            return None, None
        won, whole = self.less(worse, name), self.less(worse, best)
        return float(won.sum() / whole.sum()), statistics.of_shares(won, whole, self.draws.units)


def _why_unranked(scored: Mapping[str, Scored], subset: str, name: str, draws: Draws) -> str:
    """Why an agent with k samples that did not see the truth has no rank; empty where it has."""
    kept = scored[STP]
    if reason := statistics.why_unranked(subset, kept.weights[subset], kept.units, [g.owner for g in kept.targets]):
        return reason
    paired = Paired(scored, "all", draws)
    for limit in (STP, f"{name}, stp"):
        if subset != "all" and limit in scored:
            worse = paired.difference(name, limit) / scored[limit].rows["all"]["error"]
            if statistics.guarded(worse, paired.p(name, limit)):
                return "worse than STP on all"
    return ""


def _of_run(run: Run) -> Row:
    """Arrays per target [n], 0 where missing, and numbers of the whole run under "run"."""
    found = shown.of_targets(run)
    covered = np.array([x is not None for x in found], dtype=bool)
    plain = shown.plain_errors(run)
    names = {"minADE": "min_ade", "minFDE": "min_fde", "energy_score": "energy"}
    arrays = {name: np.array([getattr(x, of, 0.0) for x in found]) for name, of in names.items()}
    complete = {"brier": shown.brier, "false_per_frame": shown.false_per_frame, "epa": shown.epa, "ap_f": shown.ap_f}
    whole = {name: number(run) if run.complete else None for name, number in complete.items()} | {
        "fixed_error": shown.fixed_error(run),
        "pi_ade": shown.planning_aware(run, plain),
        "one_sample": _mean(covered, np.array([getattr(x, "one_sample", 0.0) for x in found])),
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
        "effective_targets": statistics.effective([float(x) for x in w]),
        "effective_objects": statistics.effective(sums_of([g.owner for g in targets], w)),
        "effective_units": statistics.effective(sums_of(units, w)),
        "objects": len({g.owner for g in there}),
    }


def _mean(w: Floats, values: Floats) -> float | None:
    return float((w * values).sum() / w.sum()) if w.sum() > 0 else None


def _total(costs: Mapping[str, float | None], parts: Sequence[str]) -> float | None:
    found = [cost for part in parts if (cost := costs.get(part)) is not None]
    return sum(found) if found else None


def _over_seeds(rows: Sequence[Row]) -> Row:
    names = rows[0] if rows else {}
    known = {name: [row[name] for row in rows if row[name] is not None] for name in names}
    return {name: np.mean(values, axis=0) if values else None for name, values in known.items()}
