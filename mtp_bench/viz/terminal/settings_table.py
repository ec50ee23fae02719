"""A table of settings: a row per agent and setting."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import Column, Table, Value, columns_of
from ...scoring import (
    Clear,
    Details,
    Report,
    Row,
    Subset,
    blocks_of,
    main_settings,
)

ROW_COLUMNS = {column.key: column for column in columns_of(Row)}


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


def settings_table(
    report: Report, name: str, title: str, keys: Sequence[str], *subsets: Subset
) -> Table:
    """Return a table of all settings, lowest bADE first.

    It has the columns ``keys`` of ``subsets``, which are named above their columns if
    they are several. Columns that do not depend on the subset stand at the end, once.
    """
    lines = sorted(agent_lines(report), key=sort_error)
    of_agents = {column.key: column for column in _agent_columns()}
    columns = _pick(of_agents, ("agent", "hypotheses", "samples"))
    for subset in subsets:
        group = subset if len(subsets) > 1 else ""
        for column in _pick(ROW_COLUMNS, keys):
            on_subset = subset_column(column, subset, column.title)
            columns.append(replace(on_subset, group=group))
    columns += _pick(of_agents, keys)
    return Table(name, title, "", lines, columns)


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
