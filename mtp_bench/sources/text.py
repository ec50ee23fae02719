"""Text files of datasets, read into arrays; every error names the file and the line that is wrong."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..types import Bools, Floats, Ints

LIMIT = 1e9  # of a number: far beyond metres, pixels, frames and identities
TURN = 8 * np.pi  # rad; an angle that is never wrapped may be some turns beyond one
RADIANS = "expected radians, such as -pi to pi; np.radians(yaw) makes radians of degrees"
MOST_LETTERS = 200  # of a word: an array has room for the longest in every row
_FEW = 10  # columns, which an error can name


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of numbers of a text file."""

    path: Path
    columns: Sequence[str]
    line: Ints  # [R] line in the file, from 1
    value: Floats  # [R, columns]; 0 in the column of texts
    text: NDArray[np.str_]  # [R] the column of texts; empty where there is none

    def refuse(self, bad: Bools, what: str | Callable[[int], str]) -> None:
        """Raise DataError for the first row where ``bad``; ``what`` is wrong may depend on the row."""
        refuse(bad, lambda at: f"{self.path}, line {self.line[at]}: {what if isinstance(what, str) else what(at)}")

    def refuse_not_finite(self, first: int | None = None) -> None:
        """Raise DataError for NaN, infinity or a number beyond `LIMIT` in the ``first`` columns, or in all."""
        bad = ~(np.abs(self.value[:, :first]) <= LIMIT)

        def what(at: int) -> str:
            place = int(np.argmax(bad[at]))
            return f"{self.columns[place]} is {self.value[at, place]:g}, expected a finite number up to {LIMIT:g}"

        self.refuse(np.asarray(bad.any(axis=1)), what)

    def refuse_degrees(self, column: str, rows: Bools | None = None) -> None:
        """Raise DataError for an angle of some turns, in all ``rows`` or in these: it is in degrees."""
        value = self.value[:, self.columns.index(column)]
        turned = np.isfinite(value) & (np.abs(value) > TURN)
        bad = turned if rows is None else rows & turned
        self.refuse(bad, lambda at: f"{column} is {value[at]:g}, {RADIANS}")

    def whole(self, column: str) -> Ints:
        """A column as integers; DataError where one is not whole."""
        value = self.value[:, self.columns.index(column)]
        bad = ~((np.abs(value) <= LIMIT) & (value == np.round(value)))
        self.refuse(bad, lambda at: f"{column} is {value[at]:g}, expected a whole number up to {LIMIT:g}")
        return value.astype(np.int64)

    def refuse_second_box(self, frame: Ints, object_id: Ints, row: Ints) -> None:
        """Raise DataError where, among the rows ``row``, an object has two boxes in a frame."""
        twice = np.zeros(len(frame), dtype=bool)
        twice[row] = repeated(frame[row], object_id[row])
        self.refuse(twice, lambda at: f"a second box of object {object_id[at]} in frame {frame[at]}")


def refuse(bad: Bools, what: Callable[[int], str]) -> None:
    """Raise DataError, which says ``what`` is wrong, for the first row where ``bad``."""
    if bad.any():
        raise DataError(what(int(np.argmax(bad))))


def repeated(*keys: NDArray[Any]) -> Bools:
    """Which rows have all the ``keys`` ``[R]`` of an earlier row."""
    order = np.lexsort(keys)  # rows that are alike stay in their order
    again = np.zeros(len(order), dtype=bool)
    again[order[1:]] = np.all([key[order[1:]] == key[order[:-1]] for key in keys], axis=0)
    return again


def read_text(path: Path) -> str:
    """The text of a file, without the byte order mark that some editors write."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} cannot be read as text: {error}") from None


def read_json(path: Path) -> Any:
    """The content of a JSON file that fits into memory."""
    try:
        return json.loads(read_text(path))
    except RecursionError:
        raise DataError(f"{path} cannot be read as JSON: nested too deeply") from None
    except ValueError as error:
        raise DataError(f"{path} cannot be read as JSON: {error}") from None


def numbered_lines(path: Path) -> tuple[Ints, list[str]]:
    """Lines that are not blank, and their numbers from 1."""
    lines = read_text(path).splitlines()
    kept = [number for number, line in enumerate(lines, 1) if line.strip()]
    return np.array(kept, dtype=np.int64), [lines[number - 1] for number in kept]


def read_table(path: Path, columns: str, delimiter: str | None = None, text: str = "") -> Table:
    """Numbers in the named ``columns`` of a file; an empty file gives no rows.

    ``columns``: their names, blanks between them. ``delimiter`` of the file: None for blanks. ``text``: the column that
    holds texts, if any. DataError names the line, and the column, that is wrong.
    """
    number, lines = numbered_lines(path)
    names = columns.split()
    kinds: list[Any] = [(name, "U16" if name == text else "f8") for name in names]
    none = np.empty(0, dtype="U16")
    if not lines:
        return Table(path, names, number, np.empty((0, len(names))), none)
    try:
        table = np.loadtxt(lines, dtype=kinds, delimiter=delimiter, comments=None, ndmin=1)
    except ValueError as error:
        _explain(path, number, lines, names, delimiter, text)
        raise DataError(f"{path}: {error}") from None
    value = np.column_stack([np.zeros(len(table)) if name == text else table[name] for name in names])
    return Table(path, names, number, value, table[text] if text else none)


def _explain(
    path: Path, number: Ints, lines: list[str], columns: Sequence[str], delimiter: str | None, text: str
) -> None:
    """Raise DataError for the first row that is no row of the table."""
    for at, line in zip(number, lines, strict=True):
        cells = line.split(delimiter)
        if len(cells) != len(columns):
            named = f" ({', '.join(columns)})" if len(columns) <= _FEW else ""
            raise DataError(
                f"{path}, line {at}: {len(cells)} columns, expected {len(columns)}{named}: is the file cut off?"
            )
        for place, (name, cell) in enumerate(zip(columns, cells, strict=True), 1):
            if name != text and not _is_number(cell):
                got = reprlib.repr(cell.strip())
                raise DataError(f"{path}, line {at}, column {place} ({name}): got {got}, expected a number")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
