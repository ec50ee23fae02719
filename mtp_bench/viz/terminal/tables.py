"""Tables of a report behind its main one, that of every number, and notes: warnings, and what the columns mean."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from textwrap import wrap
from typing import Any

from ...core import BLANK, Column, Table, Value, columns_of, short
from ...scoring import (
    ASSOCIATED,
    EVENTS,
    KNOWN_SUBSETS,
    NAMES,
    NOT_CAUSAL,
    PARTS,
    RANKED_SUBSETS,
    SAW_TRUTH,
    AgentSetting,
    Bin,
    Clear,
    Details,
    PairedRow,
    Report,
    Row,
    Subset,
    blocks_of,
    heading,
    main_settings,
    shipped_env,
)
from .output import counted
from .paper import PAPER_SUBSETS, paper_figures

_EVENTS: tuple[Subset, ...] = (
    "ids",
    "reacquired",
    "lost",
    "frag",
)  # the first two may rank
_COSTS = [f"cost_{part}" for part in PARTS]
_MADE_OF: dict[str, Sequence[str]] = {
    "bADE of targets with and without a forecast": ("error", "localisation", "missed"),
    "Parts of bADE of targets with a forecast": _COSTS[:5],
    "Parts of bADE of targets without a forecast": _COSTS[5:],
}
_GAPS = (
    "gap_closed",
    "gap_interval",
    "association_gap_closed",
    "association_gap_interval",
)
_BLANK = ("gap_blank_because", "association_gap_blank_because")
_COUNTS = (
    "targets",
    "effective_targets",
    "objects",
    "effective_objects",
    "scenes",
    "effective_units",
)
_PAIRED = ("agent", "hypotheses", "other", "subset", "error", "interval", "p", "minADE")
REFERENCES = (SAW_TRUTH, ASSOCIATED)  # reasons of `why_unranked`
_LEAST = 0.005  # m: smaller parts are left out of a line
_METRES = Column(format=".2f")


@dataclass(frozen=True)
class AgentLine:
    """An agent in one setting: its rows by subset, and its details."""

    rows: Mapping[Subset, Row]
    details: Details


def paper_table(report: Report) -> Table:
    """minADE/minFDE of the settings that the paper has numbers of, here and there; no row on other scenes."""
    env = shipped_env(report)
    rows = [
        (block, figures)
        for block in blocks_of(report)
        if (figures := paper_figures(env, block["all"]))
    ]

    def pair(ours: Subset, theirs: str) -> tuple[Column, Column]:
        declared = Column(
            unit="m", group="all targets" if ours == "all" else theirs.upper()
        )
        here = replace(
            declared,
            heading="here",
            read=lambda row: _both(row[0][ours].minADE, row[0][ours].minFDE),
        )
        return here, replace(
            declared,
            heading="paper",
            read=lambda row: _both(*row[1].get(theirs, (None, None))),
        )

    named = Column(
        "agent H",
        read=lambda row: (
            row[0]["all"].agent + f" {row[0]['all'].hypotheses}".removesuffix(" 1")
        ),
    )
    columns = [
        named,
        *chain(*(pair(ours, theirs) for ours, theirs in PAPER_SUBSETS.items())),
    ]
    return Table(
        "paper",
        "minADE/minFDE here and in the paper, whose detections are others (m)",
        "",
        rows,
        columns,
    )


def _both(ade: float | None, fde: float | None) -> str | None:
    return None if ade is None or fde is None else f"{short(ade)}/{short(fde)}"


def data_table(report: Report) -> Table:
    """Every number of every subset: a row per agent, setting and subset."""
    return Table("rows", report.env, "", report.rows, _row_columns(report))


def column_keys() -> list[str]:
    """Keys of the columns that `chosen_table` can show."""
    keys = [column.key for kind in (Row, Details, Clear) for column in columns_of(kind)]
    return [key for key in dict.fromkeys(keys) if key != "subset"]


def chosen_table(
    report: Report,
    keys: Sequence[str],
    subsets: Sequence[Subset],
    all_settings: bool = True,
    names: Mapping[Subset, str] = NAMES,
    title: str = "",
) -> Table:
    """A table of the columns ``keys`` on ``subsets``: a row per agent in its main setting, or in all of them.

    Columns that do not depend on the subset stand once, at the end. ``names``: of subsets, above their columns.
    """
    chosen = main_settings(report).values()
    lines = [line for line in _lines_of(report) if all_settings or line.rows in chosen]
    lines.sort(
        key=lambda line: (
            math.inf if (error := line.rows["all"].error) is None else error
        )
    )
    of_row = {column.key: column for column in _row_columns(report)}
    once = [_of(column, lambda line: line.details) for column in columns_of(Details)]
    once += [
        _of(column, lambda line: line.details.tracking.all)
        for column in columns_of(Clear)
    ]
    naming = {"agent", "hypotheses", *keys} & AgentSetting.model_fields.keys()
    first = [column for column in once if column.key in naming]
    last = [
        column
        for key in keys
        for column in once
        if column.key == key and key not in naming
    ]
    subset_columns = [
        of_row[key] for key in keys if key in of_row and key not in naming
    ]
    columns = [
        replace(_on(each, name, each.title), group=names[name])
        for name in subsets
        for each in subset_columns
    ]
    return Table(
        "chosen", title or heading(report), "", lines, [*first, *columns, *last]
    )


def _lines_of(report: Report) -> list[AgentLine]:
    return [
        AgentLine(block, details)
        for block, details in zip(blocks_of(report), report.details, strict=True)
    ]


def full_tables(report: Report) -> Iterator[Table]:
    """All tables but the main one."""

    def table(title: str, keys: Sequence[str], *subsets: Subset) -> Table:
        names: Mapping[Subset, str] = {
            name: name if len(subsets) > 1 else "" for name in subsets
        }
        return chosen_table(
            report, ["samples", *keys], subsets, names=names, title=title
        )

    yield table("All settings (m)", ("error", "rank_range"), "all", "ids")
    yield table(
        "minADE/minFDE with the paper's subsets (m)",
        ("minADE", "minFDE"),
        "all",
        "paper_ids",
        "paper_frag",
    )
    if (paper := paper_table(report)).rows:
        yield paper
    lines = _lines_of(report)
    known = {column.key: column for column in _row_columns(report)}
    subsets = list(lines[0].rows.values()) if lines else []
    counts = [known[name] for name in ("subset", "events", *_COUNTS)]
    yield Table(
        "subsets", "Subsets (units: blocks of at most 20 s)", "", subsets, counts
    )
    yield table(
        "Error on events (m; below: 95 % interval)",
        ("error", "interval"),
        "all",
        *_EVENTS,
    )
    if "turning" in {row.subset for row in report.rows}:
        yield table(
            "Turning targets (m; below: 95 % interval)",
            (*_PAIRED[4:6], "minADE", "minFDE"),
            "all",
            "turning",
        )
    yield table(
        "minADE/minFDE on events (m, of targets with a forecast)",
        ("minADE", "minFDE"),
        *_EVENTS,
    )
    if report.paired:
        subsets_shown = ("all", *RANKED_SUBSETS, "turning")
        shown = [
            row
            for row in report.paired
            if row.error is not None and row.subset in subsets_shown
        ]
        shown.sort(key=lambda row: (row.other, KNOWN_SUBSETS.index(row.subset)))
        columns = [column for column in columns_of(PairedRow) if column.key in _PAIRED]
        yield Table(
            "paired",
            "Differences to the controls (m; below: 95 % interval)",
            "",
            shown,
            columns,
        )
    yield table("Shares of gaps closed (below: 95 % interval)", _GAPS, "all", "ids")
    yield table("Reasons of missing shares (all targets)", _BLANK, "all")
    for title, names in _MADE_OF.items():
        yield table(f"{title} (all targets, m)", names, "all")
    shown_already = {name for names in _MADE_OF.values() for name in names}
    optional = [
        key
        for key, column in known.items()
        if column.optional and key not in shown_already
    ]
    yield table("Further metrics (all targets)", optional, "all")
    others = [
        column.key
        for column in columns_of(Details)
        if column.key not in AgentSetting.model_fields
    ]
    yield table(
        "Other numbers (all targets; forecasts per live frame)",
        [*others, "ms_per_frame"],
        "all",
    )
    tracking = table(
        "Tracking of the first seed", [column.key for column in columns_of(Clear)]
    )
    yield replace(tracking, columns=[*tracking.columns, *_OWN])
    for by in ("distance", "class", "motion"):
        equal = [line for line in lines if line.details.budget == "equal"] or lines
        bins = [
            part for line in equal[:1] for part in line.details.bins if part.by == by
        ]
        if bins:
            named = [_on(column, "all") for column in columns_of(Row)[:2]]
            yield Table(
                by, f"bADE (m) by {by}, targets", "", equal, [*named, *map(_bin, bins)]
            )


def _row_columns(report: Report) -> tuple[Column, ...]:
    return columns_of(type(report.rows[0]) if report.rows else Row)


def _of(column: Column, part_of: Callable[[Any], Any], **changes: Any) -> Column:
    """A column of a part of a line as a column of lines; ``part_of`` gets the part."""
    return replace(
        column,
        read=lambda line: (part := part_of(line)) and column.value(part),
        **changes,
    )


def _on(column: Column, subset: Subset, heading: str = "") -> Column:
    """A column of report rows as a column of lines, which reads their row of ``subset``."""
    key = column.key if subset == "all" else f"{subset}_{column.key}"
    return _of(
        column,
        lambda line: line.rows.get(subset),
        key=key,
        heading=heading or column.heading,
        optional=False,
    )


def _bin(part: Bin) -> Column:
    """The error of lines in a bin; its heading ends with the number of targets."""
    heading = "\n".join(
        [*wrap(part.bin.replace("_", " "), 8), str(part.errors.targets)]
    )

    def read(line: AgentLine) -> Value:
        same = (
            each
            for each in line.details.bins
            if (each.by, each.bin) == (part.by, part.bin)
        )
        return next((each.errors.error for each in same), None)

    return Column(heading, key=part.bin, read=read)


def _own_events(line: AgentLine) -> str:
    """Own switches, losses and re-acquisitions; a star where the lineage of hypotheses was guessed, see `notes`."""
    events = "/".join(str(line.details.own_events[kind]) for kind in EVENTS)
    return events + ("*" if line.details.guessed_parents else "")


_OWN = (
    Column(key="false tracks", read=lambda line: line.details.tracking.false_tracks),
    Column("own ids/\nlost/reac.", key="own_events", read=_own_events),
    Column(
        "ids in\nall H",
        key="all_h_ids",
        read=lambda line: line.details.own["all_h_ids"].targets,
    ),
)


def notes(report: Report) -> list[str]:
    """Meaning of the columns of the tables, and of a star in them."""
    guessed = (
        "* {} states no parents: lineage of own events guessed in {:.0%} of frames"
    )
    shares = [
        (each.agent, each.guessed_parents)
        for each in report.details
        if each.guessed_parents
    ]
    return [_about(report), *(guessed.format(*share) for share in shares)]


def label_of(row: Row) -> str:
    """The agent of a row, with its number of hypotheses."""
    return f"{row.agent} (H = {row.hypotheses})" if row.hypotheses > 1 else row.agent


def parts_text(row: Row) -> str:
    """The parts of bADE of a row in one line, without those below half a centimetre."""
    parts = ((name, getattr(row, f"cost_{key}")) for key, name in PARTS.items())
    return ", ".join(
        f"{name} {_METRES.text(part)}"
        for name, part in parts
        if abs(part or 0.0) >= _LEAST
    )


def _about(report: Report) -> str:
    empty = next((details.nothing_predicted for details in report.details), None)
    nothing = "" if empty is None else f" c, if nothing is predicted: {short(empty)}."
    env = shipped_env(report)
    paper = (
        " (paper): the paper's numbers."
        if any(paper_figures(env, row) for row in report.rows)
        else ""
    )
    return (
        "minADE/FDE: of the targets with a forecast (cov.); IDS, FRAG: where plain STP has that event, as in the paper."
        f"{paper}{nothing} {BLANK} as a rank: shown only. Definitions {report.definitions}."
    )


def warnings(report: Report) -> Iterator[str]:
    """Lines that no reader may miss: agents that failed, no targets, no forecasts near them, rejected rows."""
    for agent, why in report.failures.items():
        yield f"! {agent} {why}"
    honest = [
        row
        for row in report.rows
        if row.subset == "all" and row.unranked_because not in REFERENCES
    ]
    agents = {row.agent for row in honest}
    details = [each for each in report.details if each.agent in agents]
    if report.rows and not report.rows[0].targets:
        yield "! there is no target: no object that may be one is present in all past and future frames"
    elif (
        report.rows
        and not any(row.coverage for row in honest)
        and any(d.forecasts_per_frame for d in details)
    ):
        yield "! no forecast is near a target: are detections and truth in one frame of reference, in metres?"
    for agent in dict.fromkeys(
        row.agent for row in report.rows if row.unranked_because == NOT_CAUSAL
    ):
        yield f"{agent}: never ranked, {NOT_CAUSAL}"
    if dropped := max((each.dropped_detections for each in details), default=0):
        yield f"! {counted(dropped, 'detection')} not shown to agents: beyond the range or the number of the task"
    yield from report.notes()
