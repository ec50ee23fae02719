"""Reading and writing of tables as CSV and Parquet; errors name the file, the line and the column."""

from __future__ import annotations

import os
import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, nearest
from ...files import open_regular
from ...types import Bools, Floats, Ints
from ..text import LIMIT, MOST_LETTERS, refuse
from .columns import COLUMNS, TableColumn

LARGEST_FILE = 1 << 30  # bytes
LATEST = 1e12  # s: clocks that count from 1970 fit
_FLAGS = {"true": 1.0, "false": 0.0, "1": 1.0, "0": 0.0}
_BAD_CELL = re.compile(r"In CSV column #(\d+): Row #(\d+): CSV conversion error to double: invalid value '(.*)'", re.S)


@dataclass(frozen=True, eq=False)
class ColumnTable:
    """Columns of a table with R rows."""

    source: str  # the file, for messages
    unit: str  # what ``line`` counts: lines of a text, or rows
    line: Ints  # [R]
    numbers: dict[str, Floats]  # [R] each; NaN for an empty cell
    words: dict[str, NDArray[np.str_]]  # [R] each

    def __len__(self) -> int:
        return len(self.line)

    def has(self, name: str) -> bool:
        """True if the table has the column."""
        return name in self.numbers or name in self.words

    def where(self, row: int, column: str) -> str:
        """Name of a cell, for messages."""
        return f"{self.source}, {self.unit} {self.line[row]}, column {column!r}"

    def refuse(self, bad: Bools, column: str, problem: str | Callable[[int], str]) -> None:
        """Raise DataError for the first row where ``bad``; the problem may depend on the row."""
        refuse(bad, lambda row: f"{self.where(row, column)}: {problem if isinstance(problem, str) else problem(row)}")

    def whole(self, column: str) -> Ints:
        """A column of whole numbers."""
        value = self.numbers[column]
        bad = ~((np.abs(value) <= LIMIT) & (value == np.round(value)))
        self.refuse(bad, column, lambda row: f"{value[row]:g}, expected a whole number")
        return value.astype(np.int64)

    def flags(self, column: str, default: bool) -> Bools:
        """A column of 0 and 1; ``default`` in all rows if the table does not have it."""
        if column not in self.numbers:
            return np.full(len(self), default)
        value = self.numbers[column]
        self.refuse((value != 0) & (value != 1), column, lambda row: f"{value[row]:g}, expected 0 or 1")
        return np.asarray(value == 1)


def read_table(path: Path, name: str) -> ColumnTable:
    """The table ``name`` (truth, detections, ego or tracks) in a file; raises DataError for a wrong file or cell."""
    import pyarrow
    from pyarrow import compute

    try:
        with open_regular(path) as stream:
            if (size := os.fstat(stream.fileno()).st_size) > LARGEST_FILE:
                raise DataError(f"{path}: {size >> 20} MiB, expected at most {LARGEST_FILE >> 20} MiB")
            content = _read_parquet(path, stream) if path.suffix == ".parquet" else _read_csv(path, stream, name)
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise DataError(f"{path} cannot be read as {_form(path)}: {error}") from None
    _check_names(path, content.column_names, name)
    unit, first = ("row", 1) if path.suffix == ".parquet" else ("line", 2)
    line = np.arange(first, first + content.num_rows)
    if unit == "line":  # blank lines
        filled = np.zeros(len(line), dtype=bool)
        for column in content.columns:
            is_text = pyarrow.types.is_string(column.type)
            filled |= (compute.not_equal(column, "") if is_text else compute.is_valid(column)).to_numpy()
        content, line = content.filter(filled), line[filled]
    table = ColumnTable(str(path), unit, line, {}, {})
    for column in COLUMNS[name]:
        if column.name in content.column_names:
            _add_column(table, column, content.column(column.name))
    return table


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as CSV or, by the suffix, Parquet; NaN becomes an empty cell."""
    import pyarrow
    from pyarrow import csv, parquet

    table = pyarrow.table({name: pyarrow.array(column, from_pandas=True) for name, column in columns.items()})
    if path.suffix == ".parquet":
        parquet.write_table(table, path)
    else:
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="needed"))


def _form(path: Path) -> str:
    return "Parquet" if path.suffix == ".parquet" else "CSV"


def _read_parquet(path: Path, stream: Any) -> Any:
    from pyarrow import parquet

    file = parquet.ParquetFile(stream)
    groups = range(file.metadata.num_row_groups)
    # a column of one value is small until it is read
    size = max(sum(file.metadata.row_group(i).total_byte_size for i in groups), 8 * file.metadata.num_rows)
    if size > LARGEST_FILE:
        raise DataError(f"{path}: {size >> 20} MiB unpacked, expected at most {LARGEST_FILE >> 20} MiB")
    return file.read()


def _read_csv(path: Path, stream: Any, name: str) -> Any:
    from pyarrow import ArrowInvalid, csv, float64, schema, string

    short: list[Any] = []

    def note_row(row: Any) -> str:
        short.append(row)
        return "error"

    names = _header(path, stream, name)
    kinds = {one.name: string() if one.text or one.flag else float64() for one in COLUMNS[name]}
    try:
        return csv.read_csv(
            stream,
            csv.ReadOptions(use_threads=False, column_names=names),  # only without threads rows have numbers
            csv.ParseOptions(ignore_empty_lines=False, invalid_row_handler=note_row),
            csv.ConvertOptions(column_types=kinds, null_values=[""]),
        )
    except ArrowInvalid as error:
        if short:
            row = short[0]
            got = f"{row.actual_columns} columns, expected {row.expected_columns}"
            raise DataError(f"{path}, line {row.number + 1}: {got}") from None
        if match := _BAD_CELL.match(str(error)):
            cell = f"{path}, line {int(match[2]) + 1}, column {names[int(match[1])]!r}"
            value = match[3].strip()
            got = reprlib.repr(value) if value else "an empty cell"
            raise DataError(f"{cell}: {got}, expected a number") from None
        if "Empty CSV" in str(error):
            return schema([(column, kinds[column]) for column in names]).empty_table()
        raise


def _add_column(table: ColumnTable, column: TableColumn, values: Any) -> None:
    """Add a column of an Arrow table to ``table``."""
    from pyarrow import types

    kind = values.type
    is_text = types.is_string(kind) or types.is_large_string(kind) or types.is_dictionary(kind)
    if column.text:
        if types.is_nested(kind):
            raise DataError(f"{table.source}, column {column.name!r}: {kind}, expected words")
        words = ["" if value is None else str(value).strip() for value in values.to_pylist()]
        _add_words(table, column.name, words)
    elif column.flag and is_text:
        flags = [str(value).strip().lower() for value in values.to_pylist()]
        unknown = np.array([flag not in _FLAGS for flag in flags], dtype=bool)
        table.refuse(unknown, column.name, lambda row: f"{flags[row]!r}, expected 1, 0, true or false")
        table.numbers[column.name] = np.array([_FLAGS[flag] for flag in flags], dtype=np.float64)
    elif types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_null(kind):
        empty = values.is_null().to_numpy()
        numbers = values.cast("float64", safe=False).to_numpy()
        if not column.gaps:
            table.refuse(empty, column.name, "an empty cell, expected a number")
        largest = LATEST if column.name == "time" else LIMIT
        bad = ~(np.abs(numbers) <= largest) & ~(np.isnan(numbers) & column.gaps)
        message = f"expected a finite number up to {largest:g}"
        table.refuse(bad, column.name, lambda row: f"{numbers[row]:g}, {message}")
        table.numbers[column.name] = numbers
    else:
        raise DataError(f"{table.source}, column {column.name!r}: {kind}, expected numbers")


def _add_words(table: ColumnTable, name: str, words: list[str]) -> None:
    long = np.array([len(word) > MOST_LETTERS for word in words], dtype=bool)
    message = f"expected at most {MOST_LETTERS}"
    table.refuse(long, name, lambda row: f"a word of {len(words[row])} characters, {message}")
    table.words[name] = np.array(words, dtype=np.str_)
    table.refuse(table.words[name] == "", name, "an empty cell, expected a word")


def _header(path: Path, stream: Any, table: str) -> list[str]:
    """Names of the columns in the first line of a CSV file."""
    first = stream.readline().decode("utf-8-sig")
    names = [name.strip().strip('"') for name in first.strip().split(",")]
    if names == [""]:
        raise DataError(f"{path} is empty, expected a line with the names of the columns")
    known = {column.name for column in COLUMNS[table]}
    if known.isdisjoint(names) and any(name.removeprefix("-").replace(".", "", 1).isdigit() for name in names):
        needed = ", ".join(column.name for column in COLUMNS[table] if not column.without)
        got = reprlib.repr(first.strip())
        raise DataError(f"{path}: line 1 is {got}, expected the names of the columns, such as {needed}")
    _check_names(path, names, table)
    return names


def _check_names(path: Path, names: Sequence[str], table: str) -> None:
    """Raise DataError unless these are columns of the table, each once, with all that it requires."""
    known = [column.name for column in COLUMNS[table]]
    for i, name in enumerate(names):
        if name not in known and (";" in name or "\t" in name):
            got = reprlib.repr(name)
            raise DataError(f"{path}, line 1: {got}, expected names of columns with commas between them")
        if name not in known:
            raise DataError(f"{path}: unknown column {name!r}{nearest(name, known)}; remove or rename it")
        if name in names[:i]:
            raise DataError(f"{path}: column {name!r} occurs twice, expected once")
    found = f"found: {', '.join(names)}"
    for column in COLUMNS[table]:
        if not column.without and column.name not in names:
            raise DataError(f"{path}: no column {column.name!r}: {column.meaning}; {found}")
    if ("vx" in names) != ("vy" in names):
        raise DataError(f"{path}: one of the columns 'vx' and 'vy', expected both or none")
