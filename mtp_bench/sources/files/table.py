"""Reading and writing of tables as CSV and Parquet; errors name the file, the line and the column."""

import os
import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import DataError, nearest, open_regular
from ..text import LIMIT, MOST_LETTERS, RowTable, other_separator, wrong_count
from .columns import COLUMNS, TOGETHER, TableColumn

LARGEST_FILE = 1 << 30  # bytes
LATEST = 1e12  # s: clocks that count from 1970 fit


def read_table(path: Path, name: str) -> RowTable:
    """The table ``name`` (of `columns.COLUMNS`) in a file; raises DataError for a wrong file or cell."""
    import pyarrow
    from pyarrow import compute

    is_parquet = path.suffix == ".parquet"
    try:
        with open_regular(path) as stream:
            if (size := os.fstat(stream.fileno()).st_size) > LARGEST_FILE:
                raise DataError(
                    f"{path}: {size >> 20} MiB, expected at most {LARGEST_FILE >> 20} MiB"
                )
            content = (
                _read_parquet(path, stream)
                if is_parquet
                else _read_csv(path, stream, name)
            )
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise DataError(
            f"{path} cannot be read as {'Parquet' if is_parquet else 'CSV in UTF-8'}: {error}"
        ) from None
    _check_names(path, content.column_names, name)
    line = np.arange(content.num_rows) + (1 if is_parquet else 2)
    if not is_parquet:  # blank lines
        filled = np.zeros(len(line), dtype=bool)
        for column in content.columns:
            filled |= compute.not_equal(column, "").to_numpy()
        content, line = content.filter(filled), line[filled]
    table = RowTable(str(path), "row" if is_parquet else "line", line, {}, {})
    for column in COLUMNS[name]:
        if column.name in content.column_names:
            add_column(table, column, content.column(column.name))
    return table


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as CSV or, by the suffix, Parquet; NaN becomes an empty cell."""
    import pyarrow
    from pyarrow import csv, parquet

    table = pyarrow.table(
        {
            name: pyarrow.array(column, from_pandas=True)
            for name, column in columns.items()
        }
    )
    if path.suffix == ".parquet":
        parquet.write_table(table, path)
    else:
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="needed"))


def _read_parquet(path: Path, stream: Any) -> Any:
    from pyarrow import parquet

    file = parquet.ParquetFile(stream)
    groups = range(file.metadata.num_row_groups)
    # a column of one value is small until it is read
    size = max(
        sum(file.metadata.row_group(i).total_byte_size for i in groups),
        8 * file.metadata.num_rows,
    )
    if size > LARGEST_FILE:
        raise DataError(
            f"{path}: {size >> 20} MiB unpacked, expected at most {LARGEST_FILE >> 20} MiB"
        )
    return file.read()


def _read_csv(path: Path, stream: Any, name: str) -> Any:
    """All cells as words."""
    from pyarrow import ArrowInvalid, csv, schema, string

    short: list[Any] = []

    def note_row(row: Any) -> str:
        short.append(row)
        return "error"

    names = _header(path, stream, name)
    kinds = dict.fromkeys(names, string())
    try:
        return csv.read_csv(
            stream,
            csv.ReadOptions(
                use_threads=False, column_names=names
            ),  # only without threads rows have numbers
            csv.ParseOptions(ignore_empty_lines=False, invalid_row_handler=note_row),
            csv.ConvertOptions(column_types=kinds),
        )
    except ArrowInvalid as error:
        if short:
            row = short[0]
            cells = (row.text or "").split(",")
            got = f"{row.actual_columns} columns, expected {row.expected_columns}"
            if len(cells) == row.actual_columns:  # without commas in quotes
                got = wrong_count(cells, names, last=False)
            raise DataError(f"{path}, line {row.number + 1}: {got}") from None
        if "Empty CSV" in str(error):
            return schema(list(kinds.items())).empty_table()
        raise


def add_column(table: RowTable, column: TableColumn, values: Any) -> None:
    """Add a column of an Arrow table to ``table``."""
    from pyarrow import types

    kind, name = values.type, column.name
    is_word = (
        types.is_string(kind)
        or types.is_large_string(kind)
        or types.is_dictionary(kind)
    )
    is_number = (
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_boolean(kind)
        or types.is_null(kind)
    )
    if not is_word and not is_number:
        raise DataError(
            f"{table.source}, column {name!r}: {kind}, expected {'words' if column.text else 'numbers'}"
        )
    if column.text:
        words = [
            "" if value is None else str(value).strip() for value in values.to_pylist()
        ]
        long = np.array([len(word) > MOST_LETTERS for word in words], dtype=bool)
        limit = f"expected at most {MOST_LETTERS}"
        table.refuse(
            long, lambda row: f"a word of {len(words[row])} characters, {limit}", name
        )
        table.words[name] = np.array(words, dtype=np.str_)
        table.refuse(
            (table.words[name] == "") & (not column.gaps),
            "an empty cell, expected a word",
            name,
        )
        return
    if is_word:
        values = _numbers(table, column, values)
    numbers = values.cast("float64", safe=False).to_numpy()
    if not column.gaps:
        table.refuse(
            values.is_null().to_numpy(), "an empty cell, expected a number", name
        )
    largest = LATEST if name == "time" else LIMIT
    bad = ~(np.abs(numbers) <= largest) & ~(np.isnan(numbers) & column.gaps)
    table.refuse(
        bad,
        lambda row: f"{numbers[row]:g}, expected a finite number up to {largest:g}",
        name,
    )
    if column.flag:
        table.refuse(
            (numbers != 0) & (numbers != 1),
            lambda row: f"{numbers[row]:g}, expected 0 or 1",
            name,
        )
    table.numbers[name] = numbers


def _numbers(table: RowTable, column: TableColumn, values: Any) -> Any:
    """The numbers that words stand for; null for an empty cell."""
    from pyarrow import ArrowInvalid, compute, scalar, string

    cells = compute.utf8_trim_whitespace(compute.fill_null(values.cast("string"), ""))
    if column.flag:
        cells = compute.utf8_lower(cells)
        for word, number in (("true", "1"), ("false", "0")):
            cells = compute.if_else(compute.equal(cells, word), number, cells)
    try:
        return compute.if_else(
            compute.equal(cells, ""), scalar(None, string()), cells
        ).cast("float64")
    except ArrowInvalid:
        for row, cell in enumerate(cells):
            try:
                cell.cast("float64")
            except ArrowInvalid:
                expected = "1, 0, true or false" if column.flag else "a number"
                where = table.where(row, column.name)
                raise DataError(
                    f"{where}: {reprlib.repr(cell.as_py())}, expected {expected}"
                ) from None
        raise


def _header(path: Path, stream: Any, table: str) -> list[str]:
    """Names of the columns in the first line of a CSV file."""
    first = stream.readline().decode("utf-8-sig")
    names = [name.strip().strip('"') for name in first.strip().split(",")]
    if other := other_separator(first.strip(), names, ","):
        raise DataError(f"{path}, line 1: {other}")
    if names == [""]:
        raise DataError(
            f"{path} is empty, expected a line with the names of the columns"
        )
    known = {column.name for column in COLUMNS[table]}
    if known.isdisjoint(names) and any(
        name.removeprefix("-").replace(".", "", 1).isdigit() for name in names
    ):
        needed = ", ".join(
            column.name for column in COLUMNS[table] if not column.without
        )
        got = reprlib.repr(first.strip())
        raise DataError(
            f"{path}: line 1 is {got}, expected the names of the columns, such as {needed}"
        )
    _check_names(path, names, table)
    return names


def _check_names(path: Path, names: Sequence[str], table: str) -> None:
    """Raise DataError unless these are columns of the table, each once, with all that it requires."""
    known = [column.name for column in COLUMNS[table]]
    for i, name in enumerate(names):
        if name not in known:
            raise DataError(
                f"{path}: unknown column {reprlib.repr(name)}{nearest(name, known)}; remove or rename it"
            )
        if name in names[:i]:
            raise DataError(f"{path}: column {name!r} occurs twice, expected once")
    found = f"found: {', '.join(names)}"
    for column in COLUMNS[table]:
        if not column.without and column.name not in names:
            raise DataError(
                f"{path}: no column {column.name!r}: {column.meaning}; {found}"
            )
    for group in TOGETHER:
        if 0 < len(set(group) & set(names)) < len(group):
            raise DataError(
                f"{path}: some of the columns {', '.join(map(repr, group))}, expected all or none"
            )
