"""A table of a study: typed rows, what it shows in a sentence, and its files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, fields
from typing import Annotated, Any, get_args, get_type_hints

Text = str
Count = int
Number = float | None  # None where it is not defined
Metres = Annotated[float | None, "m"]
Share = Annotated[float | None, "share"]
Milliseconds = Annotated[float | None, "ms"]
PerSecond = Annotated[float | None, "frames/s"]
Value = str | int | float | None


@dataclass(frozen=True)
class Column:
    """A column: the name of a field of the rows, and its unit."""

    name: str
    unit: str = ""

    @property
    def heading(self) -> str:
        """What stands above it in a file."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Table:
    """Rows of one kind; each is a dataclass whose fields are the columns."""

    name: str  # of its files
    title: str
    sentence: str  # what it shows
    rows: Sequence[Any]

    @property
    def columns(self) -> list[Column]:
        """The columns, in the order of the fields."""
        if not self.rows:
            return []
        kind = type(self.rows[0])
        hints = get_type_hints(kind, include_extras=True)
        return [Column(field.name, _unit(hints[field.name])) for field in fields(kind)]

    def to_csv(self) -> str:
        """CSV with units in its headings; an empty cell where a number is not defined."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.heading for column in self.columns])
        writer.writerows(astuple(row) for row in self.rows)
        return text.getvalue()

    def to_json(self) -> str:
        """JSON with title, sentence, columns and rows; null where a number is not defined."""
        content = {
            "name": self.name,
            "title": self.title,
            "sentence": self.sentence,
            "columns": [asdict(column) for column in self.columns],
            "rows": [asdict(row) for row in self.rows],
        }
        return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


Tables = dict[str, Table]  # by name


def _unit(hint: Any) -> str:
    """The unit that a type is annotated with."""
    return next((part for part in get_args(hint)[1:] if isinstance(part, str)), "")
