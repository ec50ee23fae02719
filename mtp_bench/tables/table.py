"""A table: rows of one kind, their columns, a title and a sentence."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .column import Column, Value, columns_of


@dataclass(frozen=True)
class Table:
    """Rows of one kind; without ``columns`` those that the fields of the rows declare."""

    name: str  # of its files
    title: str
    sentence: str  # what it shows
    rows: Sequence[Any]
    columns: Sequence[Column] = ()

    def __post_init__(self) -> None:
        if not self.columns and self.rows:
            object.__setattr__(self, "columns", columns_of(type(self.rows[0])))

    @property
    def pairs(self) -> list[tuple[Column, Column | None]]:
        """The columns that are shown, each with the column of its intervals; None where it has none.

        A column with ``optional`` is left out where no row has a value.
        """
        pairs: list[tuple[Column, Column | None]] = []
        for column in self.columns:
            if column.optional and all(column.value(row) is None for row in self.rows):
                continue
            if column.interval and pairs and pairs[-1][1] is None:
                pairs[-1] = pairs[-1][0], column
            else:
                pairs.append((column, None))
        return pairs

    def is_text(self, column: Column) -> bool:
        """Return True for a column of words, which is aligned left; a text with a unit holds numbers."""
        return not column.unit and any(isinstance(column.value(row), str) for row in self.rows)

    def cells(self, row: Any) -> list[str]:
        """Texts of one row, an interval in brackets behind its number."""
        return [cell_text(column, interval, row) for column, interval in self.pairs]

    @property
    def records(self) -> list[dict[str, Value]]:
        """The rows as dictionaries, by the keys of all columns."""
        return [{column.key: column.value(row) for column in self.columns} for row in self.rows]


def cell_text(column: Column, interval: Column | None, row: Any) -> str:
    """Text of a cell, an interval in brackets behind the number."""
    text = column.shown(row)
    ends = None if interval is None else interval.value(row)
    if not isinstance(ends, tuple):
        return text
    low, high = (column.text(end) for end in ends)
    return f"{text} [{low}, {high}]"
