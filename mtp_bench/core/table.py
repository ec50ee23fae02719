"""A table, and its columns: declared once for the terminal, pages and files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

Value = str | int | float | tuple[float, float] | None
Better = Literal["lower", "higher", ""]

BLANK = "–"  # shown where a value is missing
SHARE = "share"  # unit of numbers from 0 to 1 that are shown as percentages


@dataclass(frozen=True)
class Column:
    """A column of a table.

    As metadata of an annotated field it takes the name of the field as its key. A
    column of intervals is shown with the column before it, but written to CSV and JSON
    on its own.
    """

    heading: str = ""  # empty: the key with spaces
    unit: str = ""  # "m", "ms", "share"
    better: Better = ""  # which values are better
    # format specification as in `format()`; empty: at most five characters, see `short`
    format: str = ""
    help: str = ""  # one sentence
    group: str = ""  # heading above several columns
    optional: bool = False  # left out where no row has a value
    interval: bool = False  # values are pairs (low, high)
    key: str = ""
    # value of a row; None: its attribute or item of the key
    read: Callable[[Any], Value] | None = None

    @property
    def title(self) -> str:
        """Heading, or the key in words."""
        return self.heading or self.key.replace("_", " ")

    @property
    def arrow(self) -> str:
        """Arrow towards better values.

        Empty where neither is better.
        """
        return {"lower": "↓", "higher": "↑", "": ""}[self.better]

    def value(self, row: Any) -> Value:
        """Return the value of one row.

        None where it is missing.
        It is missing in rows that are older than the column.
        """
        if self.read is not None:
            return self.read(row)
        if isinstance(row, dict):
            value: Value = row.get(self.key)
            return value
        return getattr(row, self.key, None)

    def text(self, value: Value) -> str:
        """Return a value as it is shown.

        A dash where it is missing.
        """
        if value is None:
            return BLANK
        if isinstance(value, str):
            return value
        if isinstance(value, tuple):
            return f"{self._number(value[0])} to {self._number(value[1])}"
        return self._number(value)

    def shown(self, row: Any) -> str:
        """Return the text of the cell of one row."""
        return self.text(self.value(row))

    def _number(self, value: float) -> str:
        spec = self.format
        if not spec and self.unit == SHARE:
            spec = ".0%"
        if spec:
            text = format(value, spec).replace("%", " %")
        elif isinstance(value, int):
            text = str(value)
        else:
            text = short(value)
        if not any(digit in text for digit in "123456789"):
            text = text.lstrip("+-")  # a zero has no sign
        return text.replace("-", "−")


def columns_of(kind: type) -> tuple[Column, ...]:
    """Return the columns that the annotated fields of a class declare.

    The class is a dataclass or a pydantic model. Columns have the order of the fields.
    Of several declarations of one field, as where an alias declares a unit, a later one
    adds to the earlier ones.
    """
    columns = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            continue
        parts = [part for part in get_args(hint)[1:] if isinstance(part, Column)]
        values: dict[str, Any] = {"key": name}
        for part in parts:
            for key, value in vars(part).items():
                if value != _DEFAULTS[key]:
                    values[key] = value
        if parts:
            columns.append(Column(**values))
    return tuple(columns)


_DEFAULTS = vars(Column())


def counted(number: int | None, noun: str, plural: str = "s") -> str:
    """Return a number with its noun, "1 event" or "2 events".

    None gives "unknown events".
    """
    if number == 1:
        return f"1 {noun}"
    if number is None:
        return f"unknown {noun}{plural}"
    return f"{number} {noun}{plural}"


def short(value: float | None) -> str:
    """Return a number in at most five characters and its sign."""
    if value is None:
        return BLANK
    # from each limit on, a number rounded to so many digits is a character longer
    for digits, limit in ((3, 9.9995), (2, 99.995), (1, 999.95)):
        if abs(value) < limit:
            return f"{value:.{digits}f}"
    return f"{value:.0f}"


@dataclass(frozen=True)
class Table:
    """Rows of one kind.

    Without ``columns`` it has those that the fields of the rows declare.
    """

    name: str  # name of its files
    title: str
    sentence: str  # what it shows
    rows: Sequence[Any]
    columns: Sequence[Column] = ()

    def __post_init__(self) -> None:
        if not self.columns and self.rows:
            object.__setattr__(self, "columns", columns_of(type(self.rows[0])))

    @property
    def pairs(self) -> list[tuple[Column, Column | None]]:
        """Shown columns, each with the column of its intervals.

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
        """Return True for a column of words, which is aligned left.

        A text with a unit holds numbers.
        """
        return not column.unit and any(
            isinstance(column.value(row), str) for row in self.rows
        )

    def cells(self, row: Any) -> list[str]:
        """Return the texts of one row, intervals in brackets behind their numbers."""
        texts = []
        for column, interval in self.pairs:
            text = column.shown(row)
            if ends := interval_texts(column, interval, row):
                text += f" [{', '.join(ends)}]"
            texts.append(text)
        return texts

    @property
    def records(self) -> list[dict[str, Value]]:
        """Rows as dictionaries, by the keys of all columns."""
        return [
            {column.key: column.value(row) for column in self.columns}
            for row in self.rows
        ]


def interval_texts(column: Column, interval: Column | None, row: Any) -> list[str]:
    """Return the two ends of the interval of a cell.

    Empty without one.
    """
    ends = None if interval is None else interval.value(row)
    return [column.text(end) for end in ends] if isinstance(ends, tuple) else []
