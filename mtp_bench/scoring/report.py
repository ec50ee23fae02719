"""The report of a comparison: rows per agent, setting and subset, and differences."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import Card, FilesSource
from ..core import counted
from .bade import ONE_PER_TARGET
from .definitions import DEFINITIONS, Subset
from .details import details
from .parts import mean_costs, reference_errors
from .rank import (
    ALONE_TEXT,
    GapPairs,
    Place,
    References,
    gap_columns,
    guard_reason,
    pairs_of,
    places_on,
    why_unranked,
)
from .report_tables import Report
from .rows import PairedRow, Row
from .statistics import (
    bootstrap_interval,
    effective_number,
    numbers_of,
    paired_difference,
    ratio,
)
from .table import AgentScores, AgentTable, agent_table, require_same_targets
from .weights import Reference

CONTROLS = ("stp", "stp_same_samples", "stp_neighbours")  # differences are to them


def summarise(
    agents: Sequence[AgentScores],
    card: Card,
    reference: Reference | None = None,
    stp: str = "stp",
    truth: str = "gt_tracks",
    references: Mapping[str, References | None] | None = None,
    with_each_other: bool = False,
) -> Report:
    """Return the report of ``agents`` on the same scenes of ``card``.

    ``reference``: event weights, and the constants of the card that set budgets;
    without it events have no targets, and budgets are one false forecast per target.
    ``stp`` and ``truth`` name the agents between which gap_closed measures. Differences
    are to `CONTROLS`, which have equal k and are left out if absent; with
    ``with_each_other`` each agent is compared with all behind it in the list.
    ``references``: by agent, the runs with its own predictor and presence model; None
    if its manifest does not state them, missing if they were not run. One agent alone
    has no rank. Raises RolloutError if agents differ in scenes or targets.
    """
    references = references or {}
    all_tables = _tables_of(agents, references, reference)
    tables = [_split(all_tables[setting], references) for setting in agents]
    equal_budget = _equal_budget(tables)
    stp_table = equal_budget.get(stp)
    truth_table = equal_budget.get(truth)
    pairs = [
        pairs_of(table, stp_table, truth_table, references, all_tables)
        for table in tables
    ]
    places = _places(tables, stp_table, pairs)
    rows = []
    for table, gaps, agent_places in zip(tables, pairs, places, strict=True):
        for subset in table.subsets:
            place = agent_places[subset]
            rows.append(_row(table, subset, stp_table, gaps, place))
    controls = [equal_budget[name] for name in CONTROLS if name in equal_budget]
    paired = _paired_rows(tables, controls)
    if with_each_other:
        paired = []
        for i, table in enumerate(tables):
            paired += _paired_rows([table], tables[i + 1 :])
    return Report(
        env=card.id,
        definitions=DEFINITIONS,
        rows=rows,
        paired=paired,
        details=[details(table, card) for table in tables],
        condition=_condition(tables, card, reference),
        tables=tables,
    )


def _equal_budget(tables: Sequence[AgentTable]) -> dict[str, AgentTable]:
    """Return the first table of equal k of each agent."""
    first_tables: dict[str, AgentTable] = {}
    for table in tables:
        if table.setting.budget == "equal":
            first_tables.setdefault(table.setting.agent, table)
    return first_tables


def _tables_of(
    agents: Sequence[AgentScores],
    references: Mapping[str, References | None],
    reference: Reference | None,
) -> dict[AgentScores | None, AgentTable]:
    """Return the tables of agents and their references.

    Raises RolloutError if they differ in scenes or targets.
    """
    tables: dict[AgentScores | None, AgentTable] = {}
    for setting in agents:
        tables[setting] = agent_table(setting, reference)
    for setting in agents[1:]:
        names = f"agents {agents[0].agent!r} and {setting.agent!r}"
        require_same_targets(agents[0].seeds[0], setting.seeds[0], names)
    for agent, runs in references.items():
        for run in runs or ():
            if run is not None and run not in tables:
                names = f"{agents[0].agent!r} and a reference of {agent!r}"
                require_same_targets(agents[0].seeds[0], run.seeds[0], names)
                tables[run] = agent_table(run, reference)
    return tables


def _split(
    table: AgentTable, references: Mapping[str, References | None]
) -> AgentTable:
    """Return the table with errors of the references that split its errors."""
    runs = references.get(table.setting.agent)
    # the truth has no detections to associate
    if runs is None or table.setting.observe == "truth":
        return table
    samples = table.setting.samples
    errors = reference_errors(runs.associated, runs.tracks, samples)
    return replace(table, split=errors)


def _condition(
    tables: Sequence[AgentTable], card: Card, reference: Reference | None
) -> dict[str, str]:
    """Return conditions: card, detector, completeness of the truth, event weights."""
    condition = {}
    if isinstance(card.source, FilesSource):
        condition["folder"] = Path(card.source.folder or "own scenes").name
    complete = all(table.complete for table in tables)
    truth = "complete"
    if not complete:
        truth = "prediction targets only: false forecasts cannot be known"
    budget = reference.budget if reference else ONE_PER_TARGET
    return {
        **condition,
        "source": card.source.name,
        "split": card.source.split,
        "presence": card.presence or "",
        "detector": card.detector_name,
        "card": card.digest,
        "detections": _detections_text(tables, card),
        "truth": truth,
        "weights": reference.origin if reference else "none",
        "budget": budget.text(complete),
    }


def _detections_text(tables: Sequence[AgentTable], card: Card) -> str:
    """Return a text that counts the scenes of each detector.

    For detectors a and b it is "a (3 scenes); b (1 scene)".
    Detections of a user's own scenes are named as such: the stored name only says whose
    settings agents take.
    """
    detectors = Counter[str]()
    for table in tables:
        detectors |= Counter(score.detections for score in table.setting.seeds[0])
    if isinstance(card.source, FilesSource):
        stored = detectors.pop(f"{card.source.detector}, stored detections", 0)
        label = f"own detections, settings of {card.source.detector}"
        detectors += Counter({label: stored})  # without a key if it is 0
    return "; ".join(
        f"{label} ({counted(scene_count, 'scene')})"
        for label, scene_count in sorted(detectors.items())
    )


def _paired_rows(
    tables: Sequence[AgentTable], controls: Sequence[AgentTable]
) -> list[PairedRow]:
    """Return the differences of agents to others with as many samples."""
    rows = []
    for control in controls:
        for table in tables:
            same_samples = table.setting.samples == control.setting.samples
            if table is not control and same_samples:
                rows += [paired_row(table, control, subset) for subset in table.subsets]
    return rows


def paired_row(table: AgentTable, control: AgentTable, subset: Subset) -> PairedRow:
    """Return differences table - control.

    One difference is in bADE, the other in minADE over targets that both cover.
    """
    weight = table.weight[subset]
    error, interval, p = numbers_of(
        table.sums_on(subset).minus(control.sums_on(subset))
    )
    shared_weight = weight * ((table.covered > 0) & (control.covered > 0))
    # means over the seeds that cover
    table_ade = table.min_ade / np.maximum(table.covered, 1)
    control_ade = control.min_ade / np.maximum(control.covered, 1)
    ade_sums = table.per_unit(table_ade - control_ade, shared_weight)
    ade, ade_interval, _ = numbers_of(
        paired_difference(
            ade_sums, np.zeros(len(ade_sums)), table.unit_weight(shared_weight)
        )
    )
    return PairedRow(
        **table.setting.key,
        other=control.setting.agent,
        subset=subset,
        error=error,
        interval=interval,
        p=p,
        minADE=ade,
        minADE_interval=ade_interval,
        targets=int((weight > 0).sum()),
        shared=int((shared_weight > 0).sum()),
        scenes=len(np.unique(table.scene[weight > 0])),
    )


def _row(
    table: AgentTable,
    subset: Subset,
    stp: AgentTable | None,
    gaps: GapPairs,
    place: Place,
) -> Row:
    weight = table.weight[subset]
    total = float(weight.sum())
    covered = float((weight * table.covered).sum())
    bade = table.bade(subset)
    sums = table.sums_on(subset)
    seeds = len(table.setting.seeds)
    fixed_sum = sum(score.fixed_error for score in table.scores)
    # false forecasts belong to no target, so no event subset has this error
    fixed_error = ratio(fixed_sum / seeds, len(table.unit)) if subset == "all" else None
    to_stp = None
    if stp is not None and stp.setting.samples == sums.samples:
        to_stp = sums.minus(stp.sums_on(subset))
    difference, difference_interval, p = numbers_of(to_stp)

    def mean(value: Any) -> float | None:
        return ratio(float((value * weight).sum()), total)

    def mean_covered(summed: Any) -> float | None:
        return ratio(float((summed * weight).sum()), covered)

    return Row(
        **table.setting.key,
        subset=subset,
        minADE=mean_covered(table.min_ade),
        minFDE=mean_covered(table.min_fde),
        error=mean(bade.error),
        interval=bootstrap_interval(sums.error, sums.weight),
        localisation=mean(bade.error - bade.missed),
        missed=mean(bade.missed),
        error_by_score=mean(bade.by_score),
        **mean_costs(table, subset),
        plain_error=mean(table.capped),
        fixed_error=fixed_error,
        energy_score=mean_covered(table.energy_score),
        coverage=ratio(covered / seeds, total),
        difference_to_stp=difference,
        difference_interval=difference_interval,
        p=p,
        **gap_columns(table, subset, gaps),
        place=place.place,
        rank_range=place.span,
        unranked_because=place.why or None,
        targets=int((weight > 0).sum()),
        effective_targets=effective_number(weight),
        events=table.events[subset],
        objects=len(np.unique(table.person[weight > 0])),
        effective_objects=sums.effective_objects,
        scenes=len(np.unique(table.scene[weight > 0])),
        effective_units=effective_number(sums.weight),
        seeds=seeds,
        ms_per_frame=ratio(
            1e3 * sum(score.seconds * score.frames for score in table.scores),
            sum(score.frames for score in table.scores),
        ),
    )


def _places(
    tables: Sequence[AgentTable], stp: AgentTable | None, pairs: Sequence[GapPairs]
) -> list[dict[Subset, Place]]:
    """Return the places of agents by subset, or the reasons why they have none."""
    if not tables:
        return []
    unranked = []
    guarded = []
    for table, gaps in zip(tables, pairs, strict=True):
        setting = table.setting
        unranked.append(why_unranked(setting.budget, setting.samples, setting.observe))
        guarded.append(guard_reason(table, stp, gaps.own.stp))
    places = places_on(tables[0].subsets, tables, unranked, guarded)
    if len(tables) == 1:
        # alone, even an agent that predicts nothing would be the first
        for subset, place in places[0].items():
            places[0][subset] = Place(why=place.why or ALONE_TEXT)
    return places
