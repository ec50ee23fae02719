"""Tables of a report: every number, and those of ``--full``."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from textwrap import wrap

from ...core import Column, Table, Value, columns_of
from ...scoring import (
    EVENT_KINDS,
    KNOWN_SUBSETS,
    PART_NAMES,
    RANKED_SUBSETS,
    AgentSetting,
    Bin,
    Clear,
    Details,
    PairedRow,
    Report,
    Row,
    Subset,
    blocks_of,
)
from .settings_table import (
    ROW_COLUMNS,
    AgentLine,
    agent_lines,
    settings_table,
    subset_column,
)

_EVENT_SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired", "lost", "frag")
PART_KEYS = tuple(f"cost_{part}" for part in PART_NAMES)
_PARTS_WITH_FORECAST = 5  # so many of PART_KEYS, the first
PART_TABLES: dict[str, tuple[str, Sequence[str]]] = {  # name -> title and keys
    "parts_with_forecast": (
        "Parts of bADE of targets with a forecast",
        PART_KEYS[:_PARTS_WITH_FORECAST],
    ),
    "parts_without_forecast": (
        "Parts of bADE of targets without a forecast",
        PART_KEYS[_PARTS_WITH_FORECAST:],
    ),
}
_GAP_KEYS = (
    "gap_closed",
    "gap_interval",
    "association_gap_closed",
    "association_gap_interval",
)
_REASON_KEYS = (
    "unranked_because",
    "gap_blank_because",
    "association_gap_blank_because",
)
_COUNT_KEYS = (
    "subset",
    "events",
    "targets",
    "effective_targets",
    "objects",
    "effective_objects",
    "scenes",
    "effective_units",
)
_PAIRED_KEYS = (
    "agent",
    "hypotheses",
    "other",
    "subset",
    "error",
    "interval",
    "p",
    "minADE",
)
_MIN_SHOWN_PART_M = 0.005
_BIN_HEADING_WIDTH = 8
_METRES = Column(format=".2f")


def data_table(report: Report) -> Table:
    """Return every number: a row per agent, setting and subset."""
    return Table("rows", report.env, "", report.rows, list(ROW_COLUMNS.values()))


def full_tables(report: Report) -> Iterator[Table]:
    """Yield all tables but the main one."""
    displacements = ("minADE", "minFDE")
    yield settings_table(
        report, "settings", "All settings (m)", ("error", "rank_range"), "all", "ids"
    )
    yield settings_table(
        report,
        "paper_subsets",
        "minADE/minFDE with the paper's subsets (m)",
        displacements,
        "all",
        "paper_ids",
        "paper_frag",
    )
    yield _subset_table(report)
    yield settings_table(
        report,
        "event_errors",
        "Error on events (m; below: 95 % interval)",
        ("error", "interval"),
        *_EVENT_SUBSETS,
    )
    if "turning" in next(blocks_of(report), {}):
        yield settings_table(
            report,
            "turning",
            "Turning targets (m; below: 95 % interval)",
            ("error", "interval", *displacements),
            "all",
            "turning",
        )
    yield settings_table(
        report,
        "event_displacements",
        "minADE/minFDE on events (m, of targets with a forecast)",
        displacements,
        *_EVENT_SUBSETS[1:],
    )
    if report.paired:
        yield paired_table(report)
    yield settings_table(
        report,
        "gaps",
        "Shares of gaps closed (below: 95 % interval)",
        _GAP_KEYS,
        "all",
        "ids",
    )
    yield from _tables_of_all_targets(report)
    yield _tracking_table(report)
    yield from _bin_tables(report)


def _subset_table(report: Report) -> Table:
    """Return the targets, objects, scenes and units of each subset."""
    rows = list(next(blocks_of(report), {}).values())
    columns = [ROW_COLUMNS[key] for key in _COUNT_KEYS]
    title = "Subsets (units: blocks of at most 20 s)"
    return Table("subsets", title, "", rows, columns)


def paired_table(report: Report) -> Table:
    """Return the differences of agents to others, by the other and subset."""
    shown_subsets = ("all", *RANKED_SUBSETS, "turning")
    rows = []
    for row in report.paired:
        if row.error is not None and row.subset in shown_subsets:
            rows.append(row)
    rows.sort(key=lambda row: (row.other, KNOWN_SUBSETS.index(row.subset)))
    columns = [column for column in columns_of(PairedRow) if column.key in _PAIRED_KEYS]
    title = "Differences of agents (m; below: 95 % interval)"
    return Table("differences", title, "", rows, columns)


def _tables_of_all_targets(report: Report) -> Iterator[Table]:
    """Yield the tables over all targets, such as parts of bADE."""
    yield settings_table(
        report,
        "reasons",
        "Reasons of missing ranks and shares (all targets)",
        _REASON_KEYS,
        "all",
    )
    part_keys: set[str] = set()
    for name, (title, keys) in PART_TABLES.items():
        part_keys.update(keys)
        yield settings_table(report, name, f"{title} (all targets, m)", keys, "all")
    optional_keys = [
        key
        for key, column in ROW_COLUMNS.items()
        if column.optional and key not in part_keys
    ]
    yield settings_table(
        report, "further", "Further metrics (all targets)", optional_keys, "all"
    )
    number_keys = [
        column.key
        for column in columns_of(Details)
        if column.key not in AgentSetting.model_fields
    ]
    yield settings_table(
        report,
        "other",
        "Other numbers (all targets; forecasts per live frame)",
        [*number_keys, "ms_per_frame"],
        "all",
    )


def _tracking_table(report: Report) -> Table:
    """Return tracking numbers and own events of the first seed."""
    keys = [column.key for column in columns_of(Clear)]
    table = settings_table(report, "tracking", "Tracking of the first seed", keys)
    return replace(table, columns=[*table.columns, *_OWN_EVENT_COLUMNS])


def _own_events(line: AgentLine) -> str | None:
    """Return own events, with a star if the lineage was guessed.

    None without tracks.
    """
    if line.details.own_events["ids"] is None:
        return None
    events = "/".join(str(line.details.own_events[kind]) for kind in EVENT_KINDS)
    if line.details.guessed_parents:
        events += "*"
    return events


def _switches_in_all(line: AgentLine) -> int | None:
    """Return the number of targets that switch in all hypotheses."""
    errors = line.details.own["all_h_ids"]
    return None if errors is None else errors.targets


_OWN_EVENT_COLUMNS = (
    Column(key="false tracks", read=lambda line: line.details.tracking.false_tracks),
    Column("own ids/\nlost/reac.", key="own_events", read=_own_events),
    Column("ids in\nall H", key="all_h_ids", read=_switches_in_all),
)


def _bin_tables(report: Report) -> Iterator[Table]:
    """Yield bADE by distance, class and motion, at equal samples."""
    lines = agent_lines(report)
    # reports without settings at equal samples show all
    lines = [line for line in lines if line.details.budget == "equal"] or lines
    if not lines:
        return
    agent_and_hypotheses = columns_of(Row)[:2]
    setting_columns = [subset_column(column, "all") for column in agent_and_hypotheses]
    for by in ("distance", "class", "motion"):
        bins = [
            target_bin for target_bin in lines[0].details.bins if target_bin.by == by
        ]
        if bins:
            columns = [*setting_columns, *map(_bin_column, bins)]
            yield Table(by, f"bADE (m) by {by}, targets", "", lines, columns)


def _bin_column(target_bin: Bin) -> Column:
    """Return the column of bADE in a bin, with its targets in the heading."""
    heading_lines = wrap(target_bin.bin.replace("_", " "), _BIN_HEADING_WIDTH)
    heading_lines.append(str(target_bin.errors.targets))

    def read(line: AgentLine) -> Value:
        for candidate in line.details.bins:
            if (candidate.by, candidate.bin) == (target_bin.by, target_bin.bin):
                return candidate.errors.error
        return None

    return Column("\n".join(heading_lines), key=target_bin.bin, read=read)


def parts_text(row: Row) -> str:
    """Return the parts of bADE above half a centimetre as text."""
    texts = []
    for key, name in zip(PART_KEYS, PART_NAMES.values(), strict=True):
        part_m = getattr(row, key)
        if abs(part_m or 0.0) >= _MIN_SHOWN_PART_M:
            texts.append(f"{name} {_METRES.text(part_m)}")
    return ", ".join(texts)
