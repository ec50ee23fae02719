"""Columns of a leaderboard: `columns.toml` declares them in their order."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ...core import Column, Table, Value, columns_of, toml_beside
from ...judge import rounded
from ...scoring import DrivingRow, Subset
from ..terminal.settings_table import ROW_COLUMNS
from .entries import Entry

_DECLARED = toml_beside(__file__, "columns.toml")
OPTIONAL_COLUMNS = [column for column in ROW_COLUMNS.values() if column.optional]
# keys of the columns of the page, each with the class of its cells
PAGE: dict[str, str] = _DECLARED["page"]


def _value_at(path: str, entry: Entry) -> Value:
    """Return what the attributes and keys of ``path`` lead to.

    None for an empty text.
    """
    value: Any = entry
    for name in path.split("."):
        if isinstance(value, Mapping):
            value = value.get(name)
        elif value is not None:
            value = getattr(value, name)
    if value == "":
        return None
    cell: Value = value
    return cell


def _row_value(column: Column, subset: Subset, entry: Entry) -> Value:
    """Return the value of ``column`` in an entry's row of ``subset``.

    None for drives and for subsets without results.
    """
    if entry.driving is not None or subset not in entry.sums.subsets:
        return None
    return column.value(entry.row_of(subset))


def _row_column(column: Column, subset: Subset = "all", **fields: Any) -> Column:
    """Convert a column of report rows to one of entries, with other ``fields``."""
    return replace(column, read=partial(_row_value, column, subset), **fields)


def _declared_columns(section: str) -> list[Column]:
    """Return the columns of a section of the file.

    ``metric`` names a column of rows, ``subset`` its targets, ``path`` the value of an
    entry.
    """
    columns = []
    for key, fields in _DECLARED[section].items():
        if "metric" in fields:
            row_column = ROW_COLUMNS[fields.pop("metric")]
            columns.append(_row_column(row_column, key=key, **fields))
        else:
            reader = partial(_value_at, fields.pop("path", key))
            columns.append(Column(key=key, read=reader, **fields))
    return columns


def _driving_columns() -> list[Column]:
    """Return the columns of drives, whose keys begin with "drive_"."""
    columns = []
    for column in columns_of(DrivingRow)[1:]:  # without that of the agent
        key = f"drive_{column.key.removeprefix('drive_')}"
        reader = partial(_value_at, f"driving.{column.key}")
        columns.append(replace(column, key=key, optional=True, read=reader))
    return columns


_LEADING = _declared_columns("leading")
_NUMBERS = [*_declared_columns("numbers"), *_driving_columns()]
_TRAILING = _declared_columns("trailing")
# the table of all data has the energy score among the optional numbers of rows
_ON_PAGE = [*_NUMBERS, *_declared_columns("page_numbers")]
COLUMN = {column.key: column for column in _ON_PAGE}


def board_table(entries: Sequence[Entry], name: str) -> Table:
    """Return every number of the entries, for other programs.

    The numbers are rounded as records are. An optional number that no entry has is left
    out, as that of a metric newer than all records.
    """
    row_columns = map(_row_column, OPTIONAL_COLUMNS)
    columns = []
    for column in (*_LEADING, *_NUMBERS, *row_columns, *_TRAILING):
        values = (column.value(entry) for entry in entries)
        if not column.optional or any(value is not None for value in values):
            columns.append(replace(column, read=_rounded(column)))
    return Table(name, "Leaderboard", "", entries, columns)


def _rounded(column: Column) -> Callable[[Entry], Value]:
    return lambda entry: rounded(column.value(entry))


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Value]]]:
    """Return the content of ``board --json``: a list of rows per environment.

    None stands for a missing value.
    """
    boards: dict[str, list[dict[str, Value]]] = {}
    for row in board_table(entries, "board").records:
        boards.setdefault(str(row.pop("env")), []).append(row)
    return boards


def best_text(column: Column, entries: Sequence[Entry]) -> str | None:
    """Return the text of the best value in a column.

    The values are those of the compared entries. None if neither low nor high is
    better, and for fewer than two numbers.
    """
    numbers = []
    for entry in entries:
        value = column.value(entry)
        if entry.compared and isinstance(value, (int, float)):
            numbers.append(value)
    if not column.better or len(numbers) < 2:
        return None
    best_of = {"lower": min, "higher": max}[column.better]
    return column.text(best_of(numbers))
