"""A table of a file, CSV or Parquet, as columns; every error names the file, the line and the column."""

from __future__ import annotations

import csv
import io
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, MtpBenchError, nearest
from ...files import open_regular, read_bounded
from ...types import Bools, Floats, Ints
from ..text import LIMIT, MOST_LETTERS, refuse
from .columns import COLUMNS, Column

MOST_BYTES = 1 << 30  # of a file
_FLAGS = {"true": 1.0, "false": 0.0}  # as pandas and others write them
LATEST = 1e12  # s: clocks that count from 1970 are fine


@dataclass(frozen=True, eq=False)
class Cells:
    """The columns of a table that a file has."""

    path: Path
    unit: str  # what errors count: lines of a text, or rows
    place: Ints  # [R] the line, or row, of each row, from 1
    number: dict[str, Floats]  # [R] each; NaN where a cell is empty
    text: dict[str, NDArray[np.str_]]  # [R] each

    def __len__(self) -> int:
        return len(self.place)

    def has(self, *names: str) -> bool:
        """Whether the file has all of these columns."""
        return all(name in self.number or name in self.text for name in names)

    def where(self, at: int, column: str) -> str:
        """A cell, for messages."""
        return f"{self.path}, {self.unit} {self.place[at]}, column {column!r}"

    def refuse(self, bad: Bools, column: str, what: str | Callable[[int], str]) -> None:
        """Raise DataError for the first row where ``bad``; ``what`` is wrong may depend on the row."""
        refuse(bad, lambda at: f"{self.where(at, column)}: {what if isinstance(what, str) else what(at)}")

    def whole(self, column: str) -> Ints:
        """A column of whole numbers."""
        value = self.number[column]
        bad = ~((np.abs(value) <= LIMIT) & (value == np.round(value)))
        self.refuse(bad, column, lambda at: f"{value[at]:g}, expected a whole number")
        return value.astype(np.int64)

    def flags(self, column: str, default: bool) -> Bools:
        """A column of 0 and 1; ``default`` in all rows where the file has none."""
        if column not in self.number:
            return np.full(len(self), default)
        value = self.number[column]
        self.refuse((value != 0) & (value != 1), column, lambda at: f"{value[at]:g}, expected 0 or 1")
        return np.asarray(value == 1)


def read_cells(path: Path, table: str) -> Cells:
    """The table of this name in a file: truth, detections, ego or tracks. Raises DataError for what is wrong."""
    return _read_parquet(path, table) if path.suffix == ".parquet" else _read_csv(path, table)


def _read_csv(path: Path, table: str) -> Cells:
    text = read_bounded(path, MOST_BYTES, DataError).removeprefix("\ufeff")  # some editors write a mark first
    reader = csv.reader(io.StringIO(text, newline=""))
    names: list[str] = []
    rows: list[list[str]] = []
    place: list[int] = []
    try:
        for row in reader:
            if not row:
                continue
            if not names:
                names = [name.strip() for name in row]
                _require_head(path, names, table)
                _check_names(path, names, table)
            elif len(row) != len(names):
                raise DataError(f"{path}, line {reader.line_num}: {len(row)} columns, expected {len(names)}")
            else:
                rows.append(row)
                place.append(reader.line_num)
    except csv.Error as error:
        raise DataError(f"{path}, line {reader.line_num}: {error}") from None
    if not names:
        raise DataError(f"{path} is empty, expected a line with the names of the columns")
    columns: Sequence[Sequence[str]] = list(zip(*rows, strict=True)) if rows else [()] * len(names)
    cells = Cells(path, "line", np.array(place, dtype=np.int64), {}, {})
    for name, values in zip(names, columns, strict=True):
        _add(cells, _column(table, name), values)
    return cells


def _add(cells: Cells, column: Column, values: Sequence[str]) -> None:
    """Add a column of texts to ``cells``."""
    if column.text:
        stripped = [value.strip() for value in values]
        long = np.array([len(word) > MOST_LETTERS for word in stripped], dtype=bool)
        expected = f"expected at most {MOST_LETTERS}"
        cells.refuse(long, column.name, lambda at: f"a word of {len(stripped[at])} characters, {expected}")
        words = np.array(stripped, dtype=np.str_)
        cells.refuse(words == "", column.name, "an empty cell, expected a word")
        cells.text[column.name] = words
        return
    try:
        numbers = np.array(values, dtype=np.float64)
        if any("_" in value for value in values):  # NumPy and Python would leave them out of a number
            raise ValueError
    except ValueError:
        numbers = np.array([_number(cells, column, at, value) for at, value in enumerate(values)], dtype=np.float64)
    _add_numbers(cells, column, numbers)


def _number(cells: Cells, column: Column, at: int, value: str) -> float:
    if not value.strip() and column.gaps:
        return float("nan")
    if column.flag and value.strip().lower() in _FLAGS:
        return _FLAGS[value.strip().lower()]
    try:
        if "_" not in value:
            return float(value)
        raise ValueError
    except ValueError:
        got = reprlib.repr(value.strip()) if value.strip() else "an empty cell"
        expected = "1, 0, true or false" if column.flag else "a number"
        raise DataError(f"{cells.where(at, column.name)}: {got}, expected {expected}") from None


def _add_numbers(cells: Cells, column: Column, numbers: Floats) -> None:
    most = LATEST if column.name == "time" else LIMIT
    bad = ~(np.abs(numbers) <= most)
    if column.gaps:
        bad &= ~np.isnan(numbers)
    cells.refuse(bad, column.name, lambda at: f"{numbers[at]:g}, expected a finite number up to {most:g}")
    cells.number[column.name] = numbers


def _read_parquet(path: Path, table: str) -> Cells:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise MtpBenchError(f"{path}: Parquet needs pyarrow: pip install pyarrow, or write CSV") from None
    try:
        with open_regular(path) as stream:
            file = parquet.ParquetFile(stream)
            rows, groups = file.metadata.num_rows, range(file.metadata.num_row_groups)
            size = sum(file.metadata.row_group(i).total_byte_size for i in groups)
            names = list(file.schema_arrow.names)
            _check_names(path, names, table)
            size = max(size, 8 * rows * len(names))  # a column of one value is small until it is read
            if size > MOST_BYTES:
                raise DataError(f"{path}: {rows} rows, {size >> 20} MiB, expected at most {MOST_BYTES >> 20} MiB")
            content = file.read()
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except (OSError, pyarrow.ArrowException) as error:
        raise DataError(f"{path} cannot be read as Parquet: {error}") from None
    cells = Cells(path, "row", np.arange(1, rows + 1), {}, {})
    for name in names:
        _add_arrow(cells, _column(table, name), content.column(name))
    return cells


def _add_arrow(cells: Cells, column: Column, values: Any) -> None:
    """Add a column of Parquet to ``cells``."""
    from pyarrow import types

    kind = values.type
    if column.text and types.is_nested(kind):
        raise DataError(f"{cells.path}, column {column.name!r}: {kind}, expected words")
    if column.text or (column.flag and (types.is_string(kind) or types.is_large_string(kind))):
        _add(cells, column, ["" if value is None else str(value) for value in values.to_pylist()])
        return
    if not (types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)):
        raise DataError(f"{cells.path}, column {column.name!r}: {kind}, expected numbers")
    _add_numbers(cells, column, values.cast("float64", safe=False).to_numpy(zero_copy_only=False))


def _require_head(path: Path, names: Sequence[str], table: str) -> None:
    """Raise DataError where the first line of a text is a row: no name is known, and some are numbers."""
    known = {column.name for column in COLUMNS[table]}
    if known.isdisjoint(names) and any(name.removeprefix("-").replace(".", "", 1).isdigit() for name in names):
        needed = ", ".join(dict.fromkeys(["frame", *(c.name for c in COLUMNS[table] if not c.without)]))
        got = reprlib.repr(",".join(names))
        raise DataError(f"{path}: line 1 is {got}, expected the names of the columns, such as {needed}")


def _check_names(path: Path, names: Sequence[str], table: str) -> None:
    """Raise DataError unless these are columns of the table, each once, with all that it needs."""
    known = [column.name for column in COLUMNS[table]]
    for i, name in enumerate(names):
        if name not in known:
            if ";" in name or "\t" in name:
                raise DataError(
                    f"{path}, line 1: {reprlib.repr(name)}, expected names of columns with commas between them"
                )
            raise DataError(f"{path}: unknown column {name!r}{nearest(name, known)}; take it out, or rename it")
        if name in names[:i]:
            raise DataError(f"{path}: column {name!r} is there twice, expected once")
    for column in COLUMNS[table]:
        if not column.without and column.name not in names:
            raise DataError(f"{path}: no column {column.name!r}: {column.meaning}; found: {', '.join(names)}")
    if "frame" not in names and "time" not in names:
        raise DataError(f"{path}: neither a column 'frame' nor 'time', expected one of them; found: {', '.join(names)}")
    if ("vx" in names) != ("vy" in names):
        raise DataError(f"{path}: one of the columns 'vx' and 'vy', expected both or none")


def _column(table: str, name: str) -> Column:
    return next(column for column in COLUMNS[table] if column.name == name)
