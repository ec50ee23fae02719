"""A submission that is run again: scenes in random order, and once more under a motion that nobody could know.

The seeds of a record are public, and with them how its scenes were turned and shifted: a table of coordinates as they
were shown would score. It does not under another motion; an agent that tracks and predicts scores alike. What one run
leaves in the page cache of the system for the next is of no use where nobody knows which comes next. A table relative
to the first pose of the ego works under any motion: that nobody has one of recorded scenes is what authors declare.
"""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import replace

from ..errors import RecordError
from ..gateway import Limits, SceneRun
from ..scoring import Reference
from ..scoring.rank import why_not_on
from ..scoring.rows import Row
from .record import Difference, IsolationPart, Record
from .running import Plan, evaluate_plan, run_seed, unanswered

# Share of the error by which other draws may be worse, on all targets and on event subsets that rank. Seeds of a
# baseline differ by 0.06 at most, by 0.015 where event subsets rank.
ALIKE = 0.1
_NEGLIGIBLE = 1e-3  # m
_SEEDS = 1 << 60  # as many as those of hidden runs
_chance = secrets.SystemRandom()

Runs = dict[int, list[SceneRun]]


def run_again(plan: Plan, seeds: Sequence[int], limits: Limits) -> Runs:
    """The runs of each seed in the order of ``seeds`` and of the plan; they were made in a random one."""
    found = {seed: _shuffled(plan, seed, limits) for seed in _chance.sample(list(seeds), len(seeds))}
    return {seed: found[seed] for seed in seeds}


def rows_when_moved(plan: Plan, reference: Reference, limits: Limits) -> Sequence[Row]:
    """What the submission of ``plan`` scores on each subset under one secret seed.

    Raises RecordError where the agent did not live to the end of every scene: it knows the public seeds.
    """
    seed = secrets.randbelow(_SEEDS)
    runs = {seed: _shuffled(plan, seed, limits)}
    require_whole(runs, plan.submission.name, "under a secret motion")
    return evaluate_plan(plan, runs, reference).rows


def require_whole(runs: Runs, agent: str, where: str) -> None:
    """Raise RecordError unless the agent lived to the end of every scene and answered in time.

    No scene is named, that would tell its seed.
    """
    lost = unanswered(runs)
    if lost.crashed_scenes:
        kinds = sorted({reason.partition(":")[0] for reason in lost.reasons.values()})
        raise RecordError(
            f"{agent}: runs {where} were cut short ({', '.join(kinds)}): {lost.crashed_scenes}, expected 0"
        )
    if lost.late:
        raise RecordError(f"{agent}: answers {where} came late: {lost.late}, so nothing is shown: use fewer --jobs")


def worse_when_moved(record: Record, rows: Sequence[Row]) -> Difference | None:
    """What differs where an error is worse than what the record is ranked by; None where all are alike.

    The worst of its seeds would be no measure: a table for the others, and nothing for that one, would pass.
    """
    for row in rows:
        ranked = record.row_of(row.subset)
        if row.error is None or ranked.error is None:
            continue
        if row.subset != "all" and why_not_on(row.subset, ranked.effective_objects, record.unit_weight(row.subset)):
            continue
        if row.error > ranked.error * (1 + ALIKE) + _NEGLIGIBLE:
            return Difference(f"error of {row.subset} under another motion", ranked.error, row.error)
    return None


def why_not_isolated(record: Record, held: IsolationPart) -> str:
    """Why a run again proves nothing, in a few words: what held the agent then, and now; empty where it proves."""
    for when, part in (("when the record was made", record.isolation), ("in this run", held)):
        if not part.sandboxed:
            return f"nothing held the agent {when} (isolation {part.mechanism!r})"
    return ""


def _shuffled(plan: Plan, seed: int, limits: Limits) -> list[SceneRun]:
    order = _chance.sample(plan.scenes, len(plan.scenes))
    found = {run.rollout.scene: run for run in run_seed(replace(plan, scenes=tuple(order)), seed, limits)}
    return [found[scene] for scene in plan.scenes]
