"""A submission that is run again: scenes in random order, and once more under a motion that nobody could know.

The seeds of a record are public, and with them how its scenes were turned and shifted: a table made for just those
motions would score. It does not under another one; an agent that tracks and predicts scores alike. What one run leaves
in the page cache of the system for the next is of no use where nobody knows which comes next.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ..gateway import Limits, SceneRun
from ..scoring import Reference
from .record import Difference, IsolationPart, Record
from .running import Plan, evaluate_plan, run_seed

ALIKE = 0.1  # share of the error by which other draws may be worse; a baseline's seeds differ by 0.06 at most
_NEGLIGIBLE = 1e-3  # m
_FIRST, _SEEDS = 1 << 16, 1 << 31  # far from what anybody counts up to
_chance = secrets.SystemRandom()

Runs = dict[int, list[SceneRun]]


def run_again(plan: Plan, seeds: Sequence[int], limits: Limits) -> Runs:
    """The runs of each seed in the order of ``seeds`` and of the plan; they were made in a random one."""
    found = {seed: _shuffled(plan, seed, limits) for seed in _chance.sample(list(seeds), len(seeds))}
    return {seed: found[seed] for seed in seeds}


def error_when_moved(plan: Plan, reference: Reference, limits: Limits) -> float | None:
    """Error of the submission of ``plan`` under one secret seed, metres; None without a target."""
    seed = _FIRST + secrets.randbelow(_SEEDS - _FIRST)
    return evaluate_plan(plan, {seed: _shuffled(plan, seed, limits)}, reference).rows[0].error


def worse_when_moved(record: Record, error: float | None) -> Difference | None:
    """What differs where ``error`` is worse than what the record is ranked by; None where they are alike.

    The worst of its seeds would be no measure: a table for the others, and nothing for that one, would pass.
    """
    ranked = record.row.error
    if error is None or ranked is None or error <= ranked * (1 + ALIKE) + _NEGLIGIBLE:
        return None
    return Difference("error under another motion", ranked, error)


def why_not_isolated(record: Record, held: Iterable[IsolationPart]) -> str:
    """Why a run again proves nothing, in a few words: what held the agent then, and now; empty where it proves."""
    for when, part in (("when the record was made", record.isolation), *(("in this run", each) for each in held)):
        if not part.holds:
            return f"nothing held the agent {when} (isolation {part.mechanism!r})"
    return ""


def _shuffled(plan: Plan, seed: int, limits: Limits) -> list[SceneRun]:
    order = _chance.sample(plan.scenes, len(plan.scenes))
    found = {run.rollout.scene: run for run in run_seed(replace(plan, scenes=tuple(order)), seed, limits)}
    return [found[scene] for scene in plan.scenes]
