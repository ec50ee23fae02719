"""The report of a comparison: rows per agent, setting and subset, paired differences, ranks and details."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from .definitions import DEFINITIONS, MOST_FORECASTS, RANKED_OBJECTS
from .details import details
from .statistics import bootstrap_interval, paired_interval, share_interval, shared_ranks, sign_flip_test
from .subsets import SUBSETS, ReferenceSubsets
from .table import AgentScores, AgentTable, agent_table, require_same_targets

Array = NDArray[np.float64]
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that a comparison shows; all of it can be written as JSON, None stands for undefined."""

    env: str
    definitions: str
    rows: list[Row]  # the keys of design.md, "compare --json"
    ranks: list[Row]  # agent, hypotheses, samples, subset, rank (None: shown, never ranked)
    paired: list[Row]  # differences to the controls
    details: list[Row]  # per agent: parts of the error, bins, tracking, own events
    condition: dict[str, str] = field(default_factory=dict)  # split, detector, card digest, detections, truth

    def to_json(self) -> Row:
        """The content of ``compare --json``: env, definitions and rows."""
        return {"env": self.env, "definitions": self.definitions, "rows": self.rows}


def summarise(
    agents: Sequence[AgentScores],
    card: Card,
    reference: ReferenceSubsets | None = None,
    stp: str = "stp",
    truth: str = "truth_past",
    controls: Sequence[str] = ("stp", "stp_same_budget"),
) -> Report:
    """Report of ``agents`` on the same scenes.

    ``stp`` and ``truth`` name the agents between which gap_closed measures, ``controls`` those to which differences are
    given; all of them with equal budget, and left out where absent. missing_aware of the subset "all" holds c/2 per
    spurious forecast where the truth is complete; that of the event subsets does not, because a spurious forecast
    belongs to no target. gap_closed has no spurious term anywhere. Without ``reference`` only "all" has targets. Raises
    RolloutError where agents differ in scenes or targets.
    """
    tables = [agent_table(given, reference) for given in agents]
    for given in agents[1:]:
        who = f"agents {agents[0].agent!r} and {given.agent!r}"
        require_same_targets(agents[0].seeds[0], given.seeds[0], who)
    ends = _equal(tables, stp), _equal(tables, truth)
    others = [table for name in controls if (table := _equal(tables, name)) is not None]
    return Report(
        env=card.id,
        definitions=DEFINITIONS,
        rows=[_row(table, subset, ends) for table in tables for subset in SUBSETS],
        ranks=[rank for subset in SUBSETS for rank in _ranks(tables, subset, ends[0])],
        paired=[
            {**paired_difference(table, other, subset), "gap_interval": _gap_interval(table, subset, *ends)}
            for other in others
            for table in tables
            if table is not other and table.given.samples == other.given.samples
            for subset in SUBSETS
        ],
        details=[details(table, card) for table in tables],
        condition=_condition(tables, card),
    )


def _condition(tables: Sequence[AgentTable], card: Card) -> dict[str, str]:
    """What the numbers hold for: the card, what made the detections of how many scenes, and what is known as truth."""
    scenes = tables[0].given.seeds[0] if tables else ()
    made = Counter(score.detections for score in scenes)
    complete = all(table.complete for table in tables)
    return {
        "split": card.source.split,
        "detector": card.detector_name,
        "card": card.digest,
        "detections": "; ".join(f"{label} ({n} scene{'' if n == 1 else 's'})" for label, n in sorted(made.items())),
        "truth": "complete" if complete else "prediction targets only: false positives are not measurable",
    }


def paired_difference(table: AgentTable, other: AgentTable, subset: str) -> Row:
    """Differences table - other on one subset: of the missing-aware error, and of minADE where both cover a target."""
    mask = table.mask[subset]
    count = table.per_scene(np.ones(len(mask)), mask)
    gap = _missing_aware(table, subset) - _missing_aware(other, subset)
    both = mask & (table.covered > 0) & (other.covered > 0)
    ade = _over(table.min_ade, table.covered) - _over(other.min_ade, other.covered)
    shared = table.per_scene(np.ones(len(mask)), both)
    return {
        **_setting(table),
        "other": other.given.agent,
        "subset": subset,
        "missing_aware": _ratio(gap.sum(), count.sum()),
        "interval": _listed(bootstrap_interval(gap, count)),
        "p": sign_flip_test(gap) if count.sum() else None,
        "minADE": _ratio(table.per_scene(ade, both).sum(), shared.sum()),
        "minADE_interval": _listed(bootstrap_interval(table.per_scene(ade, both), shared)),
        "targets": int(count.sum()),
        "shared": int(shared.sum()),
        "scenes": int((count > 0).sum()),
    }


def _row(table: AgentTable, subset: str, ends: tuple[AgentTable | None, AgentTable | None]) -> Row:
    mask = table.mask[subset]
    targets = int(mask.sum())
    covered = float(table.covered[mask].sum())
    error = _missing_aware(table, subset)
    count = table.per_scene(np.ones(len(mask)), mask)
    frames = sum(score.frames for score in table.scores)
    return {
        **_setting(table),
        "budget": table.given.budget,
        "subset": subset,
        "minADE": _ratio(table.min_ade[mask].sum(), covered),
        "minFDE": _ratio(table.min_fde[mask].sum(), covered),
        "missing_aware": _ratio(error.sum(), targets),
        "energy_score": _ratio(table.energy_score[mask].sum(), covered),
        "coverage": _ratio(covered / len(table.given.seeds), targets),
        "gap_closed": _gap_closed(table, subset, *ends),
        "targets": targets,
        "events": table.events[subset],
        "objects": table.objects(mask),
        "scenes": int((count > 0).sum()),
        "interval": _listed(bootstrap_interval(error, count)),
        "ms_per_frame": _ratio(1e3 * sum(score.seconds * score.frames for score in table.scores), frames),
    }


def _missing_aware(table: AgentTable, subset: str) -> Array:
    """Missing-aware error summed per scene [S]."""
    error = table.per_scene(table.capped, table.mask[subset])
    return error + table.spurious_error if subset == "all" else error


def _gap_closed(table: AgentTable, subset: str, stp: AgentTable | None, truth: AgentTable | None) -> float | None:
    """(E_STP - E_agent) / (E_STP - E_GT) at equal k; None where the denominator's interval covers 0."""
    closed, gap = _gap(table, subset, stp, truth)
    return None if gap is None else float(closed.sum() / gap.sum())


def _gap_interval(
    table: AgentTable, subset: str, stp: AgentTable | None, truth: AgentTable | None
) -> list[float] | None:
    """Interval of gap_closed over resampled scenes."""
    closed, gap = _gap(table, subset, stp, truth)
    return None if gap is None else _listed(share_interval(closed, gap))


def _gap(
    table: AgentTable, subset: str, stp: AgentTable | None, truth: AgentTable | None
) -> tuple[Array, Array | None]:
    """E_STP - E_agent and E_STP - E_GT, summed per scene [S]; None for the latter where its interval covers 0."""
    if stp is None or truth is None or len({t.given.samples for t in (table, stp, truth)}) > 1:
        return np.zeros(0), None
    mask = table.mask[subset]
    here, high, low = (t.per_scene(t.capped, mask) for t in (table, stp, truth))
    interval = paired_interval(high, low, table.per_scene(np.ones(len(mask)), mask))
    if interval is None or interval[0] <= 0.0 <= interval[1]:
        return np.zeros(0), None
    return high - here, high - low


def _ranks(tables: Sequence[AgentTable], subset: str, stp: AgentTable | None) -> list[Row]:
    """Ranks of the agents with equal budget, ideals apart; None for all where the subset has too few objects.

    Where false forecasts cost nothing because the truth is not complete, an agent that floods is not ranked either.
    """
    mask = tables[0].mask[subset] if tables else np.zeros(0, dtype=bool)
    ranked = [i for i, t in enumerate(tables) if t.given.budget == "equal" and not t.given.ideal and not floods(t, stp)]
    rank: dict[int, int] = {}
    if ranked and tables[0].objects(mask) >= RANKED_OBJECTS:
        count = tables[0].per_scene(np.ones(len(mask)), mask)
        rank = dict(zip(ranked, shared_ranks([_missing_aware(tables[i], subset) for i in ranked], count), strict=True))
    return [{**_setting(table), "subset": subset, "rank": rank.get(i)} for i, table in enumerate(tables)]


def floods(table: AgentTable, stp: AgentTable | None) -> bool:
    """Whether an agent forecasts far more objects than STP where nobody can tell which of them are false."""
    if table.complete or stp is None:
        return False
    return table.forecasts > MOST_FORECASTS * stp.forecasts


def _equal(tables: Sequence[AgentTable], name: str) -> AgentTable | None:
    """The first table of agent ``name`` with equal budget."""
    return next((t for t in tables if t.given.agent == name and t.given.budget == "equal"), None)


def _setting(table: AgentTable) -> Row:
    given = table.given
    return {"agent": given.agent, "hypotheses": given.hypotheses, "samples": given.samples}


def _ratio(top: float, bottom: float) -> float | None:
    return float(top / bottom) if bottom > 0 else None


def _over(total: Array, count: Array) -> Array:
    return np.divide(total, count, out=np.zeros_like(total), where=count > 0)


def _listed(interval: tuple[float, float] | None) -> list[float] | None:
    return None if interval is None else list(interval)
