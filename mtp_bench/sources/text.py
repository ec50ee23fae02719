"""Text and JSON files of datasets, read into arrays and records; every error names the file and the place in it."""

import codecs
import re
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..core import Bools, DataError, Floats, Ints, MissingDataError, open_regular

LIMIT = 1e9  # of a number: far beyond metres, pixels, frames and identities
SMALLEST = 1e-6  # m, of a side of a box
TURN = 8 * np.pi  # rad; an angle that is never wrapped may be some turns beyond one
RADIANS = (
    "expected radians, such as -pi to pi; np.radians(yaw) makes radians of degrees"
)
MOST_LETTERS = 200  # of a word: an array has room for the longest in every row
_SEPARATORS = {
    "commas": ",",
    "semicolons": ";",
    "tabs": "\t",
    "bars": "|",
    "blanks": None,
}
_NAN = re.compile(rb'(?<![\w"])NaN(?![\w"])')
_INFINITY = re.compile(rb'(?<![\w"])Infinity(?![\w"])')

Content = TypeVar("Content")


@dataclass(frozen=True, eq=False)
class RowTable:
    """Columns of a table with R rows; an error about a row names the file, the line and the column."""

    source: str  # the file
    unit: str  # what ``line`` counts: lines of a text, or rows
    line: Ints  # [R]
    numbers: dict[str, Floats]  # [R] each; NaN for an empty cell
    words: dict[str, NDArray[np.str_]]  # [R] each

    def __len__(self) -> int:
        return len(self.line)

    def __getitem__(self, column: str) -> Floats:
        """The numbers [R] of a column."""
        return self.numbers[column]

    def has(self, name: str) -> bool:
        """True if the table has the column."""
        return name in self.numbers or name in self.words

    def matrix(self, columns: str) -> Floats:
        """The numbers [R, n] of columns, their names with blanks between them."""
        return np.column_stack([self.numbers[name] for name in columns.split()])

    def select(self, rows: Bools) -> "RowTable":
        """The table of some of the rows [R]."""
        numbers, words = (
            {name: own[rows] for name, own in part.items()}
            for part in (self.numbers, self.words)
        )
        return RowTable(self.source, self.unit, self.line[rows], numbers, words)  # type: ignore[arg-type]

    def where(self, row: int, column: str = "") -> str:
        """Name of a row, or of a cell, for messages."""
        return f"{self.source}, {self.unit} {self.line[row]}" + (
            f", column {column!r}" if column else ""
        )

    def refuse(
        self, bad: Bools, problem: str | Callable[[int], str], column: str = ""
    ) -> None:
        """Raise DataError for the first row of ``bad`` [R]; ``problem``: the message, or a function of the row."""
        refuse(
            bad,
            lambda row: (
                f"{self.where(row, column)}: {problem if isinstance(problem, str) else problem(row)}"
            ),
        )

    def refuse_not_finite(self, columns: str) -> None:
        """Raise DataError for NaN, infinity or a number beyond `LIMIT` in these columns."""
        for column in columns.split():
            bad = ~(np.abs(self[column]) <= LIMIT)
            self.refuse(bad, f"expected a finite number up to {LIMIT:g}", column)

    def refuse_degrees(self, column: str, rows: Bools | None = None) -> None:
        """Raise DataError for an angle of some turns, in all ``rows`` or in these: it is in degrees."""
        value = self[column]
        bad = (
            np.isfinite(value)
            & (np.abs(value) > TURN)
            & (True if rows is None else rows)
        )
        self.refuse(bad, lambda row: f"{value[row]:g}, {RADIANS}", column)

    def whole(self, column: str) -> Ints:
        """A column as integers; raises DataError for a number that is not whole."""
        value = self[column]
        bad = ~((np.abs(value) <= LIMIT) & (value == np.round(value)))
        self.refuse(
            bad,
            lambda row: f"{value[row]:g}, expected a whole number up to {LIMIT:g}",
            column,
        )
        return value.astype(np.int64)

    def refuse_second_box(self, frame: Ints, object_id: Ints, rows: Ints) -> None:
        """Raise DataError if an object has two boxes in a frame, among these ``rows``."""
        twice = np.zeros(len(frame), dtype=bool)
        twice[rows] = repeated(frame[rows], object_id[rows])
        self.refuse(
            twice,
            lambda row: (
                f"a second box of object {object_id[row]} in frame {frame[row]}"
            ),
        )


def refuse(bad: Bools, what: Callable[[int], str]) -> None:
    """Raise DataError with the message ``what`` for the first row of ``bad`` [R]."""
    if bad.any():
        raise DataError(what(int(np.argmax(bad))))


def repeated(*keys: NDArray[Any]) -> Bools:
    """Rows [R] that have all the ``keys`` [R] of an earlier row."""
    order = np.lexsort(keys)  # rows that are alike stay in their order
    again = np.zeros(len(order), dtype=bool)
    again[order[1:]] = np.all(
        [key[order[1:]] == key[order[:-1]] for key in keys], axis=0
    )
    return again


def refuse_shared_place(
    frame: Ints, place: Floats, name: NDArray[Any], where: Callable[[int], str]
) -> None:
    """Raise DataError if two rows [R] of a frame have the same ``place`` [R, 2]; ``name`` [R]: of the objects."""

    def problem(row: int) -> str:
        *others, last = (
            str(each)
            for each in name[(frame == frame[row]) & (place == place[row]).all(axis=1)]
        )
        both = f"the objects {', '.join(others)} and {last} are all at x {place[row, 0]:g}, y {place[row, 1]:g}"
        return f"{where(row)}: {both}; expected a place of its own for each: leave out objects whose place is unknown"

    refuse(repeated(frame, *place.T), problem)


def read_text(path: Path) -> str:
    """The text of a file, without the byte order mark that some editors write."""
    try:
        return _content(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path} cannot be read as text: {error}; save it as UTF-8"
        ) from None


def _content(path: Path) -> bytes:
    """The bytes of a regular file after the byte order mark, if any."""
    try:
        with open_regular(path) as stream:
            return stream.read().removeprefix(codecs.BOM_UTF8)
    except FileNotFoundError:
        raise MissingDataError(f"no file {path}") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None


def numbered_lines(path: Path) -> tuple[Ints, list[str]]:
    """Numbers, from 1, and texts of the lines that are not blank."""
    lines = read_text(path).splitlines()
    kept = [number for number, line in enumerate(lines, 1) if line.strip()]
    return np.array(kept, dtype=np.int64), [lines[number - 1] for number in kept]


def read_table(
    path: Path,
    columns: str,
    delimiter: str | None = None,
    text: str = "",
    optional: str = "",
) -> RowTable:
    """Numbers in the named ``columns`` of a file; an empty file gives no rows.

    ``columns``: their names, blanks between them. ``delimiter`` of the file: None for blanks. ``text``: the column that
    holds texts, if any. ``optional``: the last column, if the first line may lack it. DataError names line and column.
    """
    number, lines = numbered_lines(path)
    names = columns.split()
    if optional and lines and len(lines[0].split(delimiter)) == len(names) - 1:
        names.remove(optional)
    kinds: list[Any] = [(name, "U16" if name == text else "f8") for name in names]
    try:
        rows = (
            np.loadtxt(lines, kinds, comments=None, delimiter=delimiter, ndmin=1)
            if lines
            else np.empty(0, kinds)
        )
    except ValueError as error:
        where, what = _first_problem(lines, names, delimiter, text) or (0, str(error))
        raise DataError(f"{path}, line {number[where]}{what}") from None
    numbers = {name: np.ascontiguousarray(rows[name]) for name in names if name != text}
    return RowTable(
        str(path), "line", number, numbers, {text: rows[text]} if text else {}
    )


def _first_problem(
    lines: list[str], columns: list[str], delimiter: str | None, text: str
) -> tuple[int, str] | None:
    """Index of the first line that does not fit the columns, and the end of the message about it."""
    for index, line in enumerate(lines):
        cells = line.split(delimiter)
        if other := other_separator(line, cells, delimiter):
            return index, f": {other}"
        if len(cells) != len(columns):
            return (
                index,
                f": {wrong_count(cells, columns, last=index == len(lines) - 1)}",
            )
        for place, (name, cell) in enumerate(zip(columns, cells, strict=True), 1):
            try:
                float("0" if name == text else cell.encode("ascii").replace(b"_", b"?"))
            except ValueError:
                got = reprlib.repr(cell.strip())
                return index, f", column {place} ({name}): got {got}, expected a number"
    return None


def other_separator(
    line: str, cells: Sequence[str], delimiter: str | None
) -> str | None:
    """The message about a line that another separator divides; None if ``delimiter`` may be right."""
    counts = {
        word: len(line.split(own))
        for word, own in _SEPARATORS.items()
        if own != delimiter
    }
    other = max(counts, key=lambda word: counts[word])
    if counts[other] == 1 or (len(cells) > 1 and not cells[0].endswith((",", ";"))):
        return None
    expected = next(word for word, own in _SEPARATORS.items() if own == delimiter)
    return f"this file is separated by {other}, expected {expected}"


def wrong_count(cells: Sequence[str], columns: Sequence[str], last: bool) -> str:
    """The message about too many or too few cells; only the last line of a file can be cut off."""
    got, count = len(cells), len(columns)
    if got > count:
        advice = f"column {count + 1} is {reprlib.repr(cells[count].strip())}: remove what is not listed"
    else:
        advice = f"column {got + 1} ({columns[got]}) is missing" + (
            ": is the file cut off?" if last else ""
        )
    return f"{got} columns, expected {count} ({', '.join(columns)}); {advice}"


def read_json(path: Path, kind: type[Content]) -> Content:
    """The content of a JSON file, decoded as ``kind``; DataError names the place in the file.

    NaN, which official files have for unknown velocities, counts as null. Infinity becomes 1e300, which no number may
    be: the error about it then names the place.
    """
    content = _content(path)
    content = _NAN.sub(b"null", content) if b"NaN" in content else content
    return decode(
        _INFINITY.sub(b"1e300", content) if b"Infinity" in content else content,
        kind,
        path,
    )


def decode(content: bytes | msgspec.Raw, kind: type[Content], where: object) -> Content:
    """JSON decoded as ``kind``; raises DataError naming ``where`` it is from, the place in it and what was expected."""
    try:
        return msgspec.json.decode(content, type=kind)
    except RecursionError:
        raise DataError(f"{where} cannot be read as JSON: nested too deeply") from None
    except msgspec.ValidationError as error:
        what, _, place = str(error).partition(" - at `$")
        raise DataError(
            f"{where}{', ' * bool(place)}{place.rstrip('`')}: {what[0].lower()}{what[1:]}"
        ) from None
    except (msgspec.DecodeError, ValueError) as error:
        cut = "; is the file cut off?" if "truncated" in str(error) else ""
        raise DataError(f"{where} cannot be read as JSON: {error}{cut}") from None
