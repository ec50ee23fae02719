"""The report of a comparison: rows per agent, setting and subset, paired differences and details."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import Card, FilesSource
from ..core import MtpBenchError, Table, counted, to_html, to_text
from .bade import ONE_PER_TARGET
from .definitions import DEFINITIONS, Subset
from .details import details
from .parts import ReferenceErrors, mean_costs, reference_errors
from .rank import (
    ALONE,
    GapPairs,
    Place,
    References,
    gap_columns,
    guard,
    pairs_of,
    places_on,
    why_unranked,
)
from .rows import Details, PairedRow, Row
from .scenes import rows_per_scene
from .statistics import bootstrap_interval, effective_number, paired_difference, ratio
from .table import AgentScores, AgentTable, agent_table, require_same_targets
from .weights import Reference

CONTROLS = (
    "stp",
    "stp_same_samples",
    "stp_neighbours",
)  # agents that differences are given to


def rejected_line(agent: str, rejected: int) -> str:
    """Note about rejected rows of an agent's actions."""
    return f"! {agent}: {counted(rejected, 'row')} rejected; `mtp-bench check` explains the errors"


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """The content of a comparison; None stands for undefined."""

    env: str
    definitions: str
    rows: list[Row]
    paired: list[PairedRow]  # differences to the controls
    details: list[Details]  # per agent
    condition: dict[str, str] = field(
        default_factory=dict
    )  # source, split, detector, card, detections, truth, weights, budget, presence; of own scenes their folder
    tables: Sequence[AgentTable] = ()  # sources of the rows, per agent
    shown: Sequence[str] = ()  # names of the agents of the main table; empty: all
    failures: Mapping[str, str] = field(
        default_factory=dict
    )  # agents that failed, which have no rows: where and why

    def __repr__(self) -> str:
        agents = len({row.agent.split(" ")[0] for row in self.rows})
        failed = f"; failed: {', '.join(self.failures)}" if self.failures else ""
        return (
            f"Report on {self._main_table().title.partition(':')[0]}, {counted(agents, 'agent')}{failed}\n"
            "print(report) shows the table, report.to_frame() and report.per_scene() have the numbers"
        )

    def __str__(self) -> str:
        warnings = [*self.notes(), *map(" ".join, self.failures.items())]
        return "\n".join([to_text(self._main_table()).rstrip(), *warnings])

    def notes(self) -> Iterator[str]:
        """Lines about the agents that no reader may miss: rejected rows, and confidences that do not come true."""
        from .report_tables import misstated_lines

        for each in self.details:
            if rejected := sum(each.invalid.values()):
                yield rejected_line(each.agent, rejected)
        yield from misstated_lines(self)

    def _repr_html_(self) -> str:
        lines = (
            f"<p>{escape(' '.join(failure))}</p>" for failure in self.failures.items()
        )
        return to_html(self._main_table()) + "".join(lines)

    def _main_table(self) -> Table:
        from .report_tables import main_table

        return main_table(self)

    def to_frame(self) -> Any:
        """The rows as a DataFrame: a row per agent, setting and subset, a column per key of ``compare --json``.

        Raises MtpBenchError if pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise MtpBenchError(
                "to_frame needs pandas, which is not installed: pip install pandas"
            ) from None
        return pandas.DataFrame(
            [row.model_dump() for row in self.rows], columns=list(Row.model_fields)
        )

    def per_scene(self) -> list[dict[str, Any]]:
        """Numbers of single scenes, as plain values: a row per agent, seed and scene; see `rows_per_scene`."""
        return list(rows_per_scene(self.tables))

    def to_json(self, *further: str) -> dict[str, Any]:
        """The content of ``compare --json``: env, definitions, rows, and the ``further`` fields that are named."""
        content: dict[str, Any] = {"env": self.env, "definitions": self.definitions}
        for name in ("rows", *further):
            part = getattr(self, name)
            content[name] = (
                part
                if name in ("condition", "failures")
                else [row.model_dump(mode="json") for row in part]
            )
        return content


def summarise(
    agents: Sequence[AgentScores],
    card: Card,
    reference: Reference | None = None,
    stp: str = "stp",
    truth: str = "gt_tracks",
    references: Mapping[str, References | None] | None = None,
) -> Report:
    """Report of ``agents`` on the same scenes of ``card``.

    ``reference``: event weights, and the constants of the card that set budgets; without it events have no targets,
    and budgets are one false forecast per target.
    ``stp`` and ``truth`` name the agents between which gap_closed measures. Differences are given to `CONTROLS`. All of
    them have equal k, and are left out if absent. ``references``: by agent, the runs with its own
    predictor and presence model; None if its manifest does not state them, missing if they were not run.
    One agent alone has no rank. Raises RolloutError if agents differ in scenes or targets.
    """
    tables = [agent_table(setting, reference) for setting in agents]
    for setting in agents[1:]:
        who = f"agents {agents[0].agent!r} and {setting.agent!r}"
        require_same_targets(agents[0].seeds[0], setting.seeds[0], who)
    beside = {id(table.setting): table for table in tables}
    known = references or {}
    for agent, runs in known.items():
        for each in filter(None, runs or ()):
            if id(each) not in beside:
                who = f"{agents[0].agent!r} and a reference of {agent!r}"
                require_same_targets(agents[0].seeds[0], each.seeds[0], who)
                beside[id(each)] = agent_table(each, reference)
    stp_table = _with_equal_budget(tables, stp)
    truth_table = _with_equal_budget(tables, truth)
    pairs = [pairs_of(table, stp_table, truth_table, known, beside) for table in tables]
    others = [
        table
        for name in CONTROLS
        if (table := _with_equal_budget(tables, name)) is not None
    ]
    rows = []
    for table, gaps, places in zip(
        tables, pairs, _places(tables, stp_table, pairs), strict=True
    ):
        runs = known.get(table.setting.agent) or References()
        # the truth has no detections to associate
        associated = None if table.setting.observe == "truth" else runs.associated
        split = reference_errors(associated, runs.tracks, table.setting.samples)
        rows += [
            _row(table, subset, stp_table, gaps, split, places[subset])
            for subset in table.subsets
        ]
    return Report(
        env=card.id,
        definitions=DEFINITIONS,
        rows=rows,
        paired=[
            paired_row(table, other, subset)
            for other in others
            for table in tables
            if table is not other and table.setting.samples == other.setting.samples
            for subset in table.subsets
        ],
        details=[details(table, card) for table in tables],
        condition=_condition(tables, card, reference),
        tables=tables,
    )


def _condition(
    tables: Sequence[AgentTable], card: Card, reference: Reference | None
) -> dict[str, str]:
    """Conditions of the numbers: card, detector, completeness of the truth, event weights."""
    scenes = tables[0].setting.seeds[0] if tables else ()
    made = Counter(score.detections for score in scenes)
    complete = all(table.complete for table in tables)
    own = ""
    if isinstance(card.source, FilesSource):
        own = Path(card.source.folder or "own scenes").name
        stored = made.pop(f"{card.source.detector}, stored detections", 0)
        made += Counter({f"own detections, settings of {card.source.detector}": stored})
    return {
        **({"folder": own} if own else {}),
        "source": card.source.name,
        "split": card.source.split,
        "presence": card.presence or "",
        "detector": card.detector_name,
        "card": card.digest,
        "detections": "; ".join(
            f"{label} ({counted(n, 'scene')})" for label, n in sorted(made.items())
        ),
        "truth": "complete"
        if complete
        else "prediction targets only: false forecasts cannot be known",
        "weights": reference.origin if reference else "none",
        "budget": (reference.budget if reference else ONE_PER_TARGET).text(complete),
    }


def paired_row(table: AgentTable, other: AgentTable, subset: Subset) -> PairedRow:
    """Differences table - other: of bADE, and of minADE over targets that both cover."""
    setting, weight = table.setting, table.weight[subset]
    error = table.sums_on(subset).minus(other.sums_on(subset))
    both = weight * ((table.covered > 0) & (other.covered > 0))
    means = (
        each.min_ade / np.maximum(each.covered, 1) for each in (table, other)
    )  # over the seeds that cover
    ade = table.per_unit(next(means) - next(means), both)
    shared = table.unit_weight(both)
    of_ade = paired_difference(ade, np.zeros(len(ade)), shared)
    return PairedRow(
        **setting.key,
        other=other.setting.agent,
        subset=subset,
        error=error and error.mean,
        interval=error and error.interval,
        p=error and error.p,
        minADE=of_ade and of_ade.mean,
        minADE_interval=of_ade and of_ade.interval,
        targets=int((weight > 0).sum()),
        shared=int((both > 0).sum()),
        scenes=len(np.unique(table.scene[weight > 0])),
    )


def _row(
    table: AgentTable,
    subset: Subset,
    stp: AgentTable | None,
    gaps: GapPairs,
    split: ReferenceErrors | None,
    place: Place,
) -> Row:
    setting, weight, ranked = table.setting, table.weight[subset], table.bade(subset)
    total, some = float(weight.sum()), weight > 0
    covered = float((weight * table.covered).sum())
    sums = table.sums_on(subset)
    fixed = ratio(
        sum(score.fixed_error for score in table.scores) / len(setting.seeds),
        len(table.unit),
    )
    to_stp = None
    if stp is not None and stp.setting.samples == setting.samples:
        to_stp = sums.minus(stp.sums_on(subset))

    def mean(value: Any) -> float | None:
        return ratio(float((value * weight).sum()), total)

    def mean_covered(summed: Any) -> float | None:
        return ratio(float((summed * weight).sum()), covered)

    return Row(
        **setting.key,
        subset=subset,
        minADE=mean_covered(table.min_ade),
        minFDE=mean_covered(table.min_fde),
        error=mean(ranked.error),
        interval=bootstrap_interval(sums.error, sums.weight),
        localisation=mean(ranked.error - ranked.missed),
        missed=mean(ranked.missed),
        error_by_score=mean(ranked.by_score),
        **mean_costs(table, subset, split),
        plain_error=mean(table.capped),
        fixed_error=fixed if subset == "all" else None,
        energy_score=mean_covered(table.energy_score),
        coverage=ratio(covered / len(setting.seeds), total),
        difference_to_stp=to_stp and to_stp.mean,
        difference_interval=to_stp and to_stp.interval,
        p=to_stp and to_stp.p,
        **gap_columns(table, subset, gaps),
        place=place.place,
        rank_range=place.span,
        unranked_because=place.why or None,
        targets=int(some.sum()),
        effective_targets=effective_number(weight),
        events=table.events[subset],
        objects=len(np.unique(table.person[some])),
        effective_objects=sums.effective_objects,
        scenes=len(np.unique(table.scene[some])),
        effective_units=effective_number(sums.weight),
        seeds=len(setting.seeds),
        ms_per_frame=ratio(
            1e3 * sum(score.seconds * score.frames for score in table.scores),
            sum(score.frames for score in table.scores),
        ),
    )


def _places(
    tables: Sequence[AgentTable], stp: AgentTable | None, pairs: Sequence[GapPairs]
) -> list[dict[Subset, Place]]:
    """Return the places of agents by subset, or the reasons why they have none."""
    settings = [table.setting for table in tables]
    unranked = [
        why_unranked(setting.budget, setting.samples, setting.observe)
        for setting in settings
    ]
    guards = [
        guard(table, stp, gaps.own.stp)
        for table, gaps in zip(tables, pairs, strict=True)
    ]
    places = places_on(tables[0].subsets if tables else (), tables, unranked, guards)
    if (
        len(tables) == 1
    ):  # alone, even an agent that predicts nothing would be the first
        return [
            {
                subset: Place(why=place.why or ALONE)
                for subset, place in places[0].items()
            }
        ]
    return places


def _with_equal_budget(tables: Sequence[AgentTable], name: str) -> AgentTable | None:
    return next(
        (t for t in tables if t.setting.agent == name and t.setting.budget == "equal"),
        None,
    )
