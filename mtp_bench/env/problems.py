"""What can be wrong with an answer, and the one sentence that says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import sentence
from ..types import Ints

_MOST_NUMBERS = 8  # of one row that are shown


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with an answer."""

    field: str
    reason: str
    expected: str
    rows: int = 1
    example: str = ""  # the first such row
    kind: str = ""  # of ROWS, where rows of it are taken out
    level: Literal["warning", "error"] = "error"
    advice: str = ""  # what to do
    outside: bool = True  # the action space does not hold it; False: the space cannot say so

    def sentence(self, where: str = "", name: str = "") -> str:
        """What was got, what was expected, in which row, and what to do; ``name`` is what to call the field."""
        several = self.rows > 1
        got = f"{name or self.field}: {self.reason}" + (f" in {self.rows} rows" if several else "")
        example = f"first {self.example}" if several else self.example
        return sentence(got, self.expected, ", ".join(text for text in (where, example) if text), self.advice)


def rows_problem(
    field: str,
    reason: str,
    expected: str,
    rows: Ints,
    values: NDArray[Any],
    kind: str = "",
    advice: str = "",
    outside: bool = True,
) -> list[Problem]:
    """The problem of the ``rows`` of a field with these ``values``, with the first as example; none without any row."""
    if not len(rows):
        return []
    example = f"{field}[{rows[0]}]{_shown(np.asarray(values[rows[0]]))}"
    level: Literal["warning", "error"] = "error" if kind else "warning"
    return [Problem(field, reason, expected, len(rows), example, kind, level, advice, outside)]


def _shown(value: NDArray[Any]) -> str:
    """The entries of a row, as far as they say something at a glance."""
    numbers = [f"{number:.4g}" if value.dtype.kind == "f" else str(number) for number in value.ravel()[:_MOST_NUMBERS]]
    more = ", ..." if value.size > _MOST_NUMBERS else ""
    return "" if value.ndim > 1 else f" = [{', '.join(numbers)}{more}]" if value.ndim else f" = {numbers[0]}"
