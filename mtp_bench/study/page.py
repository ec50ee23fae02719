"""The page of a study: one HTML file that needs nothing else, and asks nobody for anything."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..tables import BLANK
from ..viz.pages import source_of, templates_of, text_of
from .figures import Figure
from .figures.style import DARK, LIGHT
from .findings import Findings
from .gallery import Picture
from .story import chapters, facts, summary
from .table import Column, Table, Value
from .tables.where import CAUSE_NAMES

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE = Path(__file__).parent


def study_page(
    found: Findings, tables: dict[str, Table], figures: dict[str, Figure], pictures: Sequence[Picture], command: str
) -> str:
    """HTML of a study: the story with its figures, all tables, and the worst events.

    ``command``: that makes it again. Equal findings give equal bytes: no date and no random id is added.
    """
    colors = f":root{{{LIGHT}}}@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}"
    style = f"{colors}\n{text_of(_HERE, 'page.css')}"
    relations = tables["relations"].rows if "relations" in tables else ()
    content = _templates().get_template("page.html").render(
        env=found.bench.card.id, subject=found.subject.name, summary=summary(found), facts=facts(found),
        relations=relations, chapters=chapters(found, tables), figures=figures, tables=tables, pictures=pictures,
        command=command, style=style, policy=_policy(style),
    )  # fmt: skip
    return f"{content}\n"


def _policy(style: str) -> str:
    """A content security policy: nothing from anywhere; figures set styles of their own parts."""
    return (
        f"default-src 'none'; style-src-elem {source_of(style)}; style-src-attr 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def headings(table: Table) -> list[tuple[str, str, bool]]:
    """What stands above the columns of a table on the page: name, unit, whether it is the paper's."""
    return [(_heading(column), _unit(column), _of_paper(column)) for column, _ in _merged(table)]


def lines(table: Table) -> list[list[tuple[str, bool, bool]]]:
    """The cells of a table on the page: text, whether it is a number, whether it is the paper's."""
    return [
        [
            (_cell(row, column, ends), not isinstance(getattr(row, column.name), str), _of_paper(column))
            for column, ends in _merged(table)
        ]
        for row in table.rows
    ]


def _merged(table: Table) -> list[tuple[Column, tuple[Column, Column] | None]]:
    """The columns that hold something; an interval that follows a number goes with it."""
    columns = [c for c in table.columns if any(getattr(row, c.name) is not None for row in table.rows)]
    merged = list[tuple[Column, tuple[Column, Column] | None]]()
    i = 0
    while i < len(columns):
        ends = columns[i + 1 : i + 3]
        whole = len(ends) == 2 and ends[0].name.endswith("low") and ends[1].name.endswith("high")
        if whole and (columns[i].unit or columns[i].name == "value"):
            merged.append((columns[i], (ends[0], ends[1])))
            i += 3
        else:
            merged.append((columns[i], None))
            i += 1
    return merged


def _of_paper(column: Column) -> bool:
    return column.name.startswith("paper_")


def _heading(column: Column) -> str:
    name = column.name.removeprefix("paper_")
    said = CAUSE_NAMES.get(name, name.replace("_", " "))
    return f"the paper's {said}" if _of_paper(column) else said


def _unit(column: Column) -> str:
    return "%" if column.unit == "share" else column.unit


def _cell(row: Any, column: Column, ends: tuple[Column, Column] | None) -> str:
    text = shown(getattr(row, column.name), column.unit)
    if ends is None:
        return text
    low, high = (getattr(row, end.name) for end in ends)
    return text if None in (low, high) else f"{text} [{shown(low, column.unit)}, {shown(high, column.unit)}]"


def shown(value: Value, unit: str = "") -> str:
    """A value as the page has it."""
    if value is None:
        return BLANK
    if isinstance(value, float):
        if unit == "share":
            return f"{100 * value:.1f}".replace("-", "−")
        digits = 3 if abs(value) < 10 else 2 if abs(value) < 100 else 0
        return f"{value:.{digits}f}".replace("-", "−")
    return str(value)


@cache
def _templates() -> Environment:
    environment = templates_of(_HERE)
    environment.globals.update(headings=headings, lines=lines, shown=shown)
    return environment
