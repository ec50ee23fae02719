"""Tables of numbers and words, and the checks that all sources share.

An error names the file, the line and the column.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, DataError, Floats, Ints
from .text import LIMIT

SMALLEST_SIDE_M = 1e-6
MAX_STEP = 0.05  # between two numbers of a stored type
# an angle that is never wrapped may be some turns beyond one
MAX_ANGLE_RAD = 8 * np.pi
RADIANS = (
    "expected radians, such as -pi to pi; np.radians(yaw) makes radians of degrees"
)


@dataclass(frozen=True, eq=False)
class RowTable:
    """Columns of a table with R rows; an error names the file, the line, the column."""

    source: str  # the file
    unit: str  # what ``line`` counts: lines of a text, or rows
    line: Ints  # [R]
    # [R] numbers, NaN for an empty cell, or words
    columns: dict[str, NDArray[Any]]

    def __len__(self) -> int:
        return len(self.line)

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Return the numbers or words [R] of a column."""
        return self.columns[column]

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def matrix(self, columns: str) -> Floats:
        """Return the numbers [R, n] of columns, their names with blanks between."""
        return np.column_stack([self[name] for name in columns.split()])

    def select(self, rows: Bools | Ints) -> "RowTable":
        """Return the table of some of the rows [R]."""
        columns = {
            name: column_values[rows] for name, column_values in self.columns.items()
        }
        return RowTable(self.source, self.unit, self.line[rows], columns)

    def where(self, row: int, column: str = "") -> str:
        """Name a row, or a cell, for messages."""
        place = f"{self.source}, {self.unit} {self.line[row]}"
        if column:
            place += f", column {column!r}"
        return place

    def refuse(
        self,
        bad_rows: Bools | np.bool_,
        problem: str | Callable[[int], str],
        column: str = "",
    ) -> None:
        """Raise DataError for the first of the ``bad_rows`` [R].

        ``problem``: the message, or a function of the row that gives it.
        """

        def message(row: int) -> str:
            text = problem if isinstance(problem, str) else problem(row)
            return f"{self.where(row, column)}: {text}"

        refuse(bad_rows, message)

    def refuse_degrees(self, column: str) -> None:
        """Raise DataError for an angle of some turns: it is in degrees."""
        angle_rad = self[column]
        bad_rows = np.isfinite(angle_rad) & (np.abs(angle_rad) > MAX_ANGLE_RAD)
        self.refuse(bad_rows, lambda row: f"{angle_rad[row]:g}, {RADIANS}", column)

    def refuse_coarse(self, numbers: NDArray[Any], column: str) -> None:
        """Raise DataError for a number whose stored type has steps above 5 cm there.

        ``numbers`` [R]: of a column, in the type that the file or the user stores.
        """
        with np.errstate(invalid="ignore"):  # infinity has no step
            step = np.spacing(np.abs(numbers))
        advice = "store the original numbers as float64"
        self.refuse(
            step > MAX_STEP,
            lambda row: (
                f"{numbers[row]:g} stored as {numbers.dtype}, which has steps of "
                f"{step[row]:g} there; {advice}"
            ),
            column,
        )

    def whole_numbers(self, column: str) -> Ints:
        """Return a column as integers.

        Raises DataError for a number that is not whole.
        """
        column_values = self[column]
        bad_rows = ~(
            (np.abs(column_values) <= LIMIT)
            & (column_values == np.round(column_values))
        )
        expected = f"expected a whole number up to {LIMIT:g}"
        self.refuse(bad_rows, lambda row: f"{column_values[row]:g}, {expected}", column)
        return column_values.astype(np.int64)

    def refuse_second_box(
        self, frame: Ints, name: NDArray[Any], *keys: NDArray[Any]
    ) -> None:
        """Raise DataError if two rows [R] have the same frame, name and ``keys``."""
        self.refuse(
            repeated(frame, name, *keys),
            lambda row: f"a second box of object {name[row]} in frame {frame[row]}",
        )


def refuse(bad_rows: Bools | np.bool_, message: Callable[[int], str]) -> None:
    """Raise DataError with the message of the first of the ``bad_rows`` [R]."""
    if bad_rows.any():
        raise DataError(message(int(np.argmax(bad_rows))))


def repeated(*keys: NDArray[Any]) -> Bools:
    """Return the rows [R] that have all the ``keys`` [R] of an earlier row."""
    row_order = np.lexsort(keys)  # rows that are alike stay in their order
    is_repeated = np.zeros(len(row_order), dtype=bool)
    same_keys = [key[row_order[1:]] == key[row_order[:-1]] for key in keys]
    is_repeated[row_order[1:]] = np.all(same_keys, axis=0)
    return is_repeated


def refuse_shared_place(
    frame: Ints, place: Floats, name: NDArray[Any], where: Callable[[int], str]
) -> None:
    """Raise DataError if two rows [R] of a frame have the same place.

    ``place`` [R, 2]; ``name`` [R] of the objects; ``where``: name of a row.
    """

    def message(row: int) -> str:
        is_sharing = (frame == frame[row]) & (place == place[row]).all(axis=1)
        shared_names = name[is_sharing].astype(np.str_).tolist()
        x, y = place[row]
        return (
            f"{where(row)}: the objects {', '.join(shared_names[:-1])} and "
            f"{shared_names[-1]} are all at x {x:g}, y {y:g}; expected a place of its "
            "own for each: leave out objects whose place is unknown"
        )

    refuse(repeated(frame, *place.T), message)
