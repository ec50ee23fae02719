"""The reader of tables with typed columns: text, CSV, Parquet and Arrow columns."""

import os
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import DataError, Floats, nearest, open_regular
from .tables import RowTable
from .text import LIMIT, read_text, reading

# longest word: an array has room for the longest one in every row
MAX_WORD_LETTERS = 200
MAX_FILE_BYTES = 1 << 30
_BLANK = " "
_SEPARATORS = {
    "commas": ",",
    "semicolons": ";",
    "tabs": "\t",
    "bars": "|",
    "blanks": _BLANK,
}
_WORD_TYPES = ("string", "large_string", "dictionary")
_NUMBER_TYPES = ("int", "uint", "halffloat", "float", "double", "bool", "null")


@dataclass(frozen=True)
class TableColumn:
    """A column of a table."""

    name: str
    meaning: str = ""
    without: str = ""  # effect if it is missing; empty: it is required
    text: bool = False  # words instead of numbers
    gaps: bool = False  # cells may be empty
    flag: bool = False  # 1 or 0, true or false
    finite: bool = True  # False: any number, also NaN and infinity
    largest: float = LIMIT  # absolute value of a number
    together: str = ""  # a table has all or none of the columns with this word


def read_table(
    path: Path,
    columns: str,
    delimiter: str = _BLANK,
    words: str = "",
    optional: str = "",
    finite: bool = True,
) -> RowTable:
    """Read a text without a header.

    An empty file gives no rows. ``columns``: their names, with blanks between;
    ``words``: those that hold words. ``optional``: the last column, if the first line
    may lack it. ``finite``: refuse NaN, infinity and numbers beyond `LIMIT`. DataError
    names the line and the column.
    """
    file_text = read_text(path)
    if delimiter == _BLANK:
        lines = [" ".join(line.split()) for line in file_text.splitlines()]
        file_text = "\n".join(lines)
    column_names = columns.split()
    first_line = file_text.lstrip("\r\n").partition("\n")[0]
    if optional and len(first_line.split(delimiter)) == len(column_names) - 1:
        column_names.remove(optional)
    arrow_cells, line_numbers = _read_cells(path, file_text, column_names, delimiter)
    table = RowTable(str(path), "line", line_numbers, {})
    for name in column_names:
        column = TableColumn(name, text=name in words.split(), finite=finite)
        add_column(table, column, arrow_cells[name])
    return table


def read_named_table(path: Path, columns: Sequence[TableColumn]) -> RowTable:
    """Read a CSV with names in its first line, or a Parquet file.

    Raises DataError for a wrong file, column or cell.
    """
    if path.suffix == ".parquet":
        with reading(path, "Parquet"), open_regular(path) as stream:
            _require_size(path, os.fstat(stream.fileno()).st_size)
            arrow_cells = _read_parquet(path, stream)
        line_unit = "row"
        line_numbers = np.arange(1, arrow_cells.num_rows + 1)
    else:
        with reading(path, "CSV"):
            _require_size(path, path.stat().st_size)
        header, _, rows_text = read_text(path).partition("\n")
        header_names = _header_names(path, header.strip(), columns)
        line_unit = "line"
        arrow_cells, line_numbers = _read_cells(
            path, rows_text, header_names, ",", first_line=2
        )
    _check_names(path, arrow_cells.column_names, columns)
    table = RowTable(str(path), line_unit, line_numbers, {})
    for column in columns:
        if column.name in arrow_cells.column_names:
            add_column(table, column, arrow_cells[column.name])
    return table


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns as CSV or, by the suffix, Parquet.

    NaN becomes an empty cell.
    """
    import pyarrow
    from pyarrow import csv, parquet

    arrays = {
        name: pyarrow.array(column_values, from_pandas=True)
        for name, column_values in columns.items()
    }
    table = pyarrow.table(arrays)
    if path.suffix == ".parquet":
        parquet.write_table(table, path)
    else:
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="needed"))


def add_column(table: RowTable, column: TableColumn, arrow_values: Any) -> None:
    """Check an Arrow column and add it to ``table``.

    DataError names the cell.
    """
    arrow_type = str(arrow_values.type)
    is_text = arrow_type.startswith(_WORD_TYPES)
    if not is_text and not arrow_type.startswith(_NUMBER_TYPES):
        expected = "words" if column.text else "numbers"
        raise DataError(
            f"{table.source}, column {column.name!r}: {arrow_type}, expected {expected}"
        )
    if column.text:
        table.columns[column.name] = _checked_words(table, column, arrow_values)
        return
    if is_text:
        arrow_values = _parse_numbers(table, column, arrow_values)
    table.columns[column.name] = _checked_numbers(table, column, arrow_values)


def _checked_words(
    table: RowTable, column: TableColumn, arrow_values: Any
) -> NDArray[np.str_]:
    words = [
        str(word or "").strip() for word in arrow_values.cast("string").to_pylist()
    ]
    letters = np.array([len(word) for word in words], dtype=np.int64)
    expected = f"expected at most {MAX_WORD_LETTERS}"
    table.refuse(
        letters > MAX_WORD_LETTERS,
        lambda row: f"a word of {letters[row]} characters, {expected}",
        column.name,
    )
    if not column.gaps:
        table.refuse(letters == 0, "an empty cell, expected a word", column.name)
    return np.array(words, dtype=np.str_)


def _checked_numbers(table: RowTable, column: TableColumn, arrow_values: Any) -> Floats:
    numbers: Floats = arrow_values.cast("float64", safe=False).to_numpy()
    is_empty = arrow_values.is_null().to_numpy()
    if not column.gaps:
        table.refuse(is_empty, "an empty cell, expected a number", column.name)
    if column.finite:
        is_unknown = np.isnan(numbers) & column.gaps
        expected = f"expected a finite number up to {column.largest:g}"
        table.refuse(
            ~(np.abs(numbers) <= column.largest) & ~is_unknown,
            lambda row: f"{numbers[row]:g}, {expected}",
            column.name,
        )
    arrow_type = arrow_values.type
    if str(arrow_type) in ("halffloat", "float"):
        table.refuse_coarse(numbers.astype(arrow_type.to_pandas_dtype()), column.name)
    if column.flag:
        table.refuse(
            (numbers != 0) & (numbers != 1),
            lambda row: f"{numbers[row]:g}, expected 0 or 1",
            column.name,
        )
    return numbers


def _parse_numbers(table: RowTable, column: TableColumn, arrow_values: Any) -> Any:
    """Return the numbers that words stand for.

    Null for an empty cell.
    """
    from pyarrow import ArrowInvalid, compute, scalar, string

    cells = compute.utf8_trim_whitespace(
        compute.fill_null(arrow_values.cast("string"), "")
    )
    if column.flag:
        cells = compute.utf8_lower(cells)
        for word, number in (("true", "1"), ("false", "0")):
            cells = compute.if_else(compute.equal(cells, word), number, cells)
    cells = compute.if_else(compute.equal(cells, ""), scalar(None, string()), cells)
    try:
        return cells.cast("float64")
    except ArrowInvalid:
        expected = "1, 0, true or false" if column.flag else "a number"
        for row, cell in enumerate(cells):
            try:
                cell.cast("float64")
            except ArrowInvalid:
                raise DataError(
                    f"{table.where(row, column.name)}: {reprlib.repr(cell.as_py())}, "
                    f"expected {expected}"
                ) from None
        raise


def _require_size(path: Path, size_bytes: int, state: str = "") -> None:
    if size_bytes > MAX_FILE_BYTES:
        raise DataError(
            f"{path}: {size_bytes >> 20} MiB{state}, expected at most "
            f"{MAX_FILE_BYTES >> 20} MiB"
        )


def _read_parquet(path: Path, stream: Any) -> Any:
    from pyarrow import parquet

    file = parquet.ParquetFile(stream)
    groups = range(file.metadata.num_row_groups)
    group_bytes = [file.metadata.row_group(i).total_byte_size for i in groups]
    # a column of one value is small until it is read
    size_bytes = max(sum(group_bytes), 8 * file.metadata.num_rows)
    _require_size(path, size_bytes, " unpacked")
    return file.read()


def _read_cells(
    path: Path, text: str, names: Sequence[str], delimiter: str, first_line: int = 1
) -> tuple[Any, NDArray[np.int64]]:
    """Return the cells of a text as an Arrow table, and the line of each row.

    ``first_line``: number of the first line of ``text``. Blank lines are left out.
    Raises DataError for the first row with too many or too few cells.
    """
    from pyarrow import ArrowInvalid, BufferReader, compute, csv, schema, string

    types = dict.fromkeys(names, string())
    if not text.strip():
        empty = schema(list(types.items())).empty_table()
        return empty, np.zeros(0, dtype=np.int64)

    misfits: list[Any] = []

    def note_misfit(row: Any) -> str:
        misfits.append(row)
        return "error"

    first_row = text.lstrip("\r\n").partition("\n")[0]
    if problem := _other_separator(first_row, delimiter):
        line_number = first_line + text[: text.index(first_row)].count("\n")
        raise DataError(f"{path}, line {line_number}: {problem}")
    # Arrow numbers misfits only without threads
    read_options = csv.ReadOptions(use_threads=False, column_names=names)
    parse_options = csv.ParseOptions(
        delimiter=delimiter,
        ignore_empty_lines=False,
        invalid_row_handler=note_misfit,
    )
    convert_options = csv.ConvertOptions(column_types=types)
    try:
        arrow_cells = csv.read_csv(
            BufferReader(text.encode()), read_options, parse_options, convert_options
        )
    except ArrowInvalid as error:
        if not misfits:
            raise DataError(f"{path} cannot be read as a table: {error}") from None
        misfit = misfits[0]
        is_last = misfit.number == len(text.splitlines())
        problem = _layout_problem(misfit, names, delimiter, is_last)
        line_number = first_line + misfit.number - 1
        raise DataError(f"{path}, line {line_number}: {problem}") from None
    is_filled = np.zeros(arrow_cells.num_rows, dtype=bool)
    for arrow_values in arrow_cells.columns:
        is_filled |= compute.not_equal(arrow_values, "").to_numpy()
    line_numbers = first_line + np.flatnonzero(is_filled)
    return arrow_cells.filter(is_filled), line_numbers


def _other_separator(line: str, delimiter: str) -> str:
    """Describe the separator of a line if it is another one, else return ""."""
    cells = line.split(delimiter)
    # "1, 2" has blanks, but commas separate it
    if len(cells) > 1 and not cells[0].endswith((",", ";")):
        return ""
    counts = {
        word: line.strip().count(separator)
        for word, separator in _SEPARATORS.items()
        if separator != delimiter
    }
    word = max(counts, key=lambda word: counts[word])
    if not counts[word]:
        return ""
    expected = next(name for name, sign in _SEPARATORS.items() if sign == delimiter)
    return f"this file is separated by {word}, expected {expected}"


def _layout_problem(
    misfit: Any, names: Sequence[str], delimiter: str, is_last: bool
) -> str:
    """Describe a row of Arrow that has too many or too few cells.

    ``is_last``: it is the last row, which a cut-off file leaves incomplete.
    """
    line = misfit.text or ""
    count = misfit.actual_columns
    if problem := _other_separator(line, delimiter):
        return problem
    got = f"{count} columns, expected {len(names)} ({', '.join(names)})"
    cells = line.split(delimiter)
    if count < len(names):
        problem = f"{got}; column {count + 1} ({names[count]}) is missing"
        return f"{problem}: is the file cut off?" if is_last else problem
    if len(cells) != count:  # quotes hide delimiters from Arrow alone
        return got
    first_extra = reprlib.repr(cells[len(names)].strip())
    advice = "remove what is not listed"
    return f"{got}; column {len(names) + 1} is {first_extra}: {advice}"


def _header_names(path: Path, header: str, columns: Sequence[TableColumn]) -> list[str]:
    """Return the names of the columns in the first line of a CSV file."""
    if not header:
        raise DataError(
            f"{path} is empty, expected a line with the names of the columns"
        )
    if problem := _other_separator(header, ","):
        raise DataError(f"{path}, line 1: {problem}")
    names = [name.strip().strip('"') for name in header.split(",")]
    is_number = [name.lstrip("-").replace(".", "", 1).isdigit() for name in names]
    known_names = {column.name for column in columns}
    if any(is_number) and known_names.isdisjoint(names):
        required = [column.name for column in columns if not column.without]
        raise DataError(
            f"{path}: line 1 is {reprlib.repr(header)}, expected the names of the "
            f"columns, such as {', '.join(required)}"
        )
    _check_names(path, names, columns)
    return names


def _check_names(
    path: Path, names: Sequence[str], columns: Sequence[TableColumn]
) -> None:
    """Raise DataError unless the names are columns, each once, with all required."""
    known_names = [column.name for column in columns]
    for name in names:
        if name not in known_names:
            raise DataError(
                f"{path}: unknown column "
                f"{reprlib.repr(name)}{nearest(name, known_names)}; remove or rename it"
            )
        if names.count(name) > 1:
            raise DataError(f"{path}: column {name!r} occurs twice, expected once")
    for column in columns:
        if not column.without and column.name not in names:
            raise DataError(
                f"{path}: no column {column.name!r}: {column.meaning}; found: "
                f"{', '.join(names)}"
            )
    _check_groups(path, names, columns)


def _check_groups(
    path: Path, names: Sequence[str], columns: Sequence[TableColumn]
) -> None:
    """Raise DataError for some but not all of the columns that belong together."""
    groups = {column.together for column in columns if column.name in names} - {""}
    for group in sorted(groups):
        members = [column.name for column in columns if column.together == group]
        if not set(members) <= set(names):
            raise DataError(
                f"{path}: some of the columns {', '.join(map(repr, members))}, "
                "expected all or none"
            )
