"""A table of chosen columns: a row per agent and setting."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import Column, Table, Value, columns_of
from ...scoring import (
    SUBSET_NAMES,
    AgentSetting,
    Clear,
    Details,
    Report,
    Row,
    Subset,
    blocks_of,
    heading,
    main_settings,
)


@dataclass(frozen=True)
class AgentLine:
    """An agent in one setting: rows by subset, and details."""

    rows: Mapping[Subset, Row]
    details: Details


def agent_lines(report: Report) -> list[AgentLine]:
    """Return a line per agent and setting, in report order."""
    pairs = zip(blocks_of(report), report.details, strict=True)
    return [AgentLine(rows, details) for rows, details in pairs]


def main_lines(report: Report) -> list[AgentLine]:
    """Return the line of the main setting of each agent."""
    main_blocks = list(main_settings(report).values())
    return [line for line in agent_lines(report) if line.rows in main_blocks]


def row_columns(report: Report) -> dict[str, Column]:
    """Return the columns of report rows by key, with further metrics."""
    row_type = type(report.rows[0]) if report.rows else Row
    return {column.key: column for column in columns_of(row_type)}


def column_keys() -> list[str]:
    """Return the keys of the columns that `chosen_table` can show."""
    keys: dict[str, None] = {}
    for row_type in (Row, Details, Clear):
        keys |= dict.fromkeys(column.key for column in columns_of(row_type))
    del keys["subset"]
    return list(keys)


def chosen_table(
    report: Report,
    keys: Sequence[str],
    subsets: Sequence[Subset],
    all_settings: bool = True,
    names: Mapping[Subset, str] = SUBSET_NAMES,
    title: str = "",
    table_name: str = "chosen",
) -> Table:
    """Return a table of ``keys`` on ``subsets``, lowest bADE first.

    Each agent has a row for its main setting, or for each of ``all_settings``. Columns
    that do not depend on the subset stand at the end, once. ``names``: of subsets,
    above their columns.
    """
    lines = agent_lines(report) if all_settings else main_lines(report)
    lines.sort(key=sort_error)
    columns = list(_chosen_columns(report, keys, subsets, names))
    return Table(table_name, title or heading(report), "", lines, columns)


def _chosen_columns(
    report: Report,
    keys: Sequence[str],
    subsets: Sequence[Subset],
    names: Mapping[Subset, str],
) -> Iterator[Column]:
    """Yield columns of the setting, the subsets, then the agent."""
    setting_keys = {"agent", "hypotheses", *keys} & AgentSetting.model_fields.keys()
    number_keys = [key for key in keys if key not in setting_keys]
    of_agents = {column.key: column for column in _agent_columns()}
    of_rows = row_columns(report)
    for key, column in of_agents.items():
        if key in setting_keys:
            yield column
    for subset in subsets:
        for column in _pick(of_rows, number_keys):
            on_subset = subset_column(column, subset, column.title)
            yield replace(on_subset, group=names[subset])
    yield from _pick(of_agents, number_keys)


def subset_column(column: Column, subset: Subset, title: str = "") -> Column:
    """Convert a column of report rows to one of agent lines.

    It reads the row of ``subset``, whose name comes before its key.
    """
    key = column.key
    if subset != "all":
        key = f"{subset}_{key}"
    return replace(
        _part_column(column, lambda line: line.rows.get(subset)),
        key=key,
        heading=title or column.heading,
        optional=False,
    )


def _agent_columns() -> Iterator[Column]:
    """Yield the columns that do not depend on the subset."""
    for column in columns_of(Details):
        yield _part_column(column, lambda line: line.details)
    for column in columns_of(Clear):
        yield _part_column(column, lambda line: line.details.tracking.all)


def _part_column(column: Column, part_of: Callable[[AgentLine], Any]) -> Column:
    """Convert a column of a part of an agent line to one of agent lines."""

    def read(line: AgentLine) -> Value:
        part = part_of(line)
        return None if part is None else column.value(part)

    return replace(column, read=read)


def _pick(columns: Mapping[str, Column], keys: Sequence[str]) -> list[Column]:
    return [columns[key] for key in keys if key in columns]


def sort_error(line: AgentLine) -> float:
    """Return the bADE of an agent over all targets, infinite without one."""
    error = line.rows["all"].error
    return math.inf if error is None else error
