"""The report of a comparison: rows per agent, setting and subset, paired differences, ranks and details."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from .definitions import DEFINITIONS
from .details import details
from .error import scene_errors
from .rank import Entrant, enough_objects, shared_ranks, why_unranked
from .rows import Details, PairedRow, RankRow, Row
from .statistics import Gap, bootstrap_interval, gap_closed, paired_difference, ratio
from .subsets import SUBSETS, ReferenceSubsets, Subset
from .table import AgentScores, AgentTable, agent_table, require_same_targets


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that a comparison shows; None stands for undefined."""

    env: str
    definitions: str
    rows: list[Row]  # the keys of design.md, "compare --json"
    ranks: list[RankRow]
    paired: list[PairedRow]  # differences to the controls
    details: list[Details]  # per agent
    condition: dict[str, str] = field(default_factory=dict)  # split, detector, card digest, detections, truth

    def to_json(self, *further: str) -> dict[str, Any]:
        """The content of ``compare --json``: env, definitions, rows, and the ``further`` fields that are named."""
        content: dict[str, Any] = {"env": self.env, "definitions": self.definitions}
        for name in ("rows", *further):
            part = getattr(self, name)
            content[name] = part if name == "condition" else [row.model_dump(mode="json") for row in part]
        return content


class _Ends(NamedTuple):
    """The agents between which gap_closed measures; None where absent."""

    stp: AgentTable | None
    truth: AgentTable | None


def summarise(
    agents: Sequence[AgentScores],
    card: Card,
    reference: ReferenceSubsets | None = None,
    stp: str = "stp",
    truth: str = "truth_past",
    controls: Sequence[str] = ("stp", "stp_same_budget"),
) -> Report:
    """Report of ``agents`` on the same scenes of ``card``.

    ``stp`` and ``truth`` name the agents between which gap_closed measures, ``controls`` those to which differences are
    given; all of them with equal budget, and left out where absent. Without ``reference`` only "all" has targets.
    Raises RolloutError where agents differ in scenes or targets.
    """
    tables = [agent_table(setting, reference) for setting in agents]
    for setting in agents[1:]:
        who = f"agents {agents[0].agent!r} and {setting.agent!r}"
        require_same_targets(agents[0].seeds[0], setting.seeds[0], who)
    ends = _Ends(_with_equal_budget(tables, stp), _with_equal_budget(tables, truth))
    others = [table for name in controls if (table := _with_equal_budget(tables, name)) is not None]
    return Report(
        env=card.id,
        definitions=DEFINITIONS,
        rows=[_row(table, subset, ends) for table in tables for subset in SUBSETS],
        ranks=[rank for subset in SUBSETS for rank in _ranks(tables, subset, ends.stp)],
        paired=[
            _paired_row(table, other, subset, ends)
            for other in others
            for table in tables
            if table is not other and table.setting.samples == other.setting.samples
            for subset in SUBSETS
        ],
        details=[details(table, card) for table in tables],
        condition=_condition(tables, card),
    )


def _condition(tables: Sequence[AgentTable], card: Card) -> dict[str, str]:
    """What the numbers hold for: the card, what made the detections of how many scenes, and what is known as truth."""
    scenes = tables[0].setting.seeds[0] if tables else ()
    made = Counter(score.detections for score in scenes)
    complete = all(table.complete for table in tables)
    return {
        "split": card.source.split,
        "detector": card.detector_name,
        "card": card.digest,
        "detections": "; ".join(f"{label} ({n} scene{'' if n == 1 else 's'})" for label, n in sorted(made.items())),
        "truth": "complete" if complete else "prediction targets only: false positives are not measurable",
    }


def _paired_row(table: AgentTable, other: AgentTable, subset: Subset, ends: _Ends) -> PairedRow:
    """Differences table - other: of the missing-aware error, and of minADE where both cover a target."""
    setting, mask = table.setting, table.mask[subset]
    count = table.targets(mask)
    error = paired_difference(scene_errors(table, subset), scene_errors(other, subset), count)
    both = mask & (table.covered > 0) & (other.covered > 0)
    shared = table.targets(both)
    ade = table.per_scene(_mean_over_seeds(table) - _mean_over_seeds(other), both)
    gap = _gap(table, subset, ends)
    return PairedRow(
        agent=setting.agent,
        hypotheses=setting.hypotheses,
        samples=setting.samples,
        other=other.setting.agent,
        subset=subset,
        missing_aware=error and error.mean,
        interval=error and error.interval,
        p=error and error.p,
        minADE=ratio(ade.sum(), shared.sum()),
        minADE_interval=bootstrap_interval(ade, shared),
        targets=int(count.sum()),
        shared=int(shared.sum()),
        scenes=int((count > 0).sum()),
        gap_interval=gap and gap.interval,
    )


def _row(table: AgentTable, subset: Subset, ends: _Ends) -> Row:
    setting, mask = table.setting, table.mask[subset]
    targets = int(mask.sum())
    covered = float(table.covered[mask].sum())
    error, count = scene_errors(table, subset), table.targets(mask)
    gap = _gap(table, subset, ends)
    seconds = sum(score.seconds * score.frames for score in table.scores)
    return Row(
        agent=setting.agent,
        hypotheses=setting.hypotheses,
        samples=setting.samples,
        budget=setting.budget,
        subset=subset,
        minADE=ratio(table.min_ade[mask].sum(), covered),
        minFDE=ratio(table.min_fde[mask].sum(), covered),
        missing_aware=ratio(error.sum(), targets),
        energy_score=ratio(table.energy_score[mask].sum(), covered),
        coverage=ratio(covered / len(setting.seeds), targets),
        gap_closed=gap and gap.closed,
        targets=targets,
        events=table.events[subset],
        objects=table.objects(mask),
        scenes=int((count > 0).sum()),
        interval=bootstrap_interval(error, count),
        ms_per_frame=ratio(1e3 * seconds, sum(score.frames for score in table.scores)),
    )


def _gap(table: AgentTable, subset: Subset, ends: _Ends) -> Gap | None:
    """What an agent closes of the gap; None at another k than the ends have, or without them."""
    if ends.stp is None or ends.truth is None or len({t.setting.samples for t in (table, ends.stp, ends.truth)}) > 1:
        return None
    mask = table.mask[subset]
    error, stp, truth = (each.per_scene(each.capped, mask) for each in (table, ends.stp, ends.truth))
    return gap_closed(error, stp, truth, table.targets(mask))


def _ranks(tables: Sequence[AgentTable], subset: Subset, stp: AgentTable | None) -> list[RankRow]:
    """Ranks of all agents on one subset."""
    beside = None if stp is None else _entrant(stp)
    ranked = [i for i, table in enumerate(tables) if why_unranked(_entrant(table), beside) is None]
    rank: dict[int, int] = {}
    if ranked and enough_objects(tables[0].objects(tables[0].mask[subset])):
        errors = [scene_errors(tables[i], subset) for i in ranked]
        rank = dict(zip(ranked, shared_ranks(errors, tables[0].targets(tables[0].mask[subset])), strict=True))
    return [
        RankRow(
            agent=table.setting.agent,
            hypotheses=table.setting.hypotheses,
            samples=table.setting.samples,
            subset=subset,
            rank=rank.get(i),
        )
        for i, table in enumerate(tables)
    ]


def _entrant(table: AgentTable) -> Entrant:
    setting = table.setting
    return Entrant(setting.budget, setting.samples, setting.ideal, table.complete, table.forecasts)


def _with_equal_budget(tables: Sequence[AgentTable], name: str) -> AgentTable | None:
    """The first table of agent ``name`` with equal budget."""
    return next((t for t in tables if t.setting.agent == name and t.setting.budget == "equal"), None)


def _mean_over_seeds(table: AgentTable) -> NDArray[np.float64]:
    """MinADE [n] of each target over the seeds that cover it, 0 where none does."""
    return np.divide(table.min_ade, table.covered, out=np.zeros_like(table.min_ade), where=table.covered > 0)
