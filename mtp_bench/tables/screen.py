"""Writers of tables for people: plain text of a terminal, and HTML of a notebook."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from html import escape
from itertools import chain, groupby
from typing import Any

from .column import Column
from .table import Table

WIDTH = 80
_LEAST = 12  # columns of the first column, which is folded where the table would be wider than WIDTH


def to_text(table: Table, width: int = WIDTH) -> str:
    """Plain text with the title above and the sentence below, both wrapped at ``width``.

    An interval stands beside its number. The first column is aligned left, and folded where the table would not fit.
    """
    columns = [column for pair in table.pairs for column in pair if column is not None]
    heads = [column.heading or "95 %" if column.interval else column.title for column in columns]
    body = [[_cell(column, row) for column in columns] for row in table.rows]
    widths = [max(map(len, cells)) for cells in zip(heads, *body, strict=True)]
    room = max(width - sum(widths[1:]) - len(widths) + 1, _LEAST)
    names = [_folded(cells[0], room) for cells in body]
    widths[:1] = [max(map(len, [*heads[:1], *chain(*names)]), default=0)]
    lines = [_line(heads, widths), "─" * (sum(widths) + len(widths) - 1)]
    for (first, *more), cells in zip(names, body, strict=True):
        lines += [_line([first, *cells[1:]], widths), *more]
    groups = [_groups(columns, widths)] if any(column.group for column in columns) else []
    texts = [textwrap.wrap(text, width) for text in (table.title, table.sentence)]
    return "\n".join([*texts[0], *groups, *lines, *texts[1]]) + "\n"


def _cell(column: Column, row: Any) -> str:
    value = column.value(row)
    if not isinstance(value, tuple):
        return column.text(value)
    low, high = map(column.text, value)
    return f"{low} to {high}" if "−" in low else f"{low}–{high}"


def _folded(name: str, width: int) -> list[str]:
    """Lines of a name, broken before an underscore, a blank or a hyphen where that is possible."""
    lines = [""]
    for part in re.findall(r"[ _-]*[^ _-]*", name):
        lines += [part] if lines[-1] and len(lines[-1] + part) > width else [lines.pop() + part]
    return [piece.strip() for line in lines for piece in textwrap.wrap(line, width)] or [""]


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = [
        cell.rjust(wide) if place else cell.ljust(wide)
        for place, (cell, wide) in enumerate(zip(cells, widths, strict=True))
    ]
    return " ".join(padded).rstrip()


def _groups(columns: Sequence[Column], widths: Sequence[int]) -> str:
    """The line of headings above groups of columns; a column of intervals belongs to the one before it."""
    names: list[str] = []
    for column in columns:
        names.append(names[-1] if column.interval else column.group)
    parts = []
    for name, members in groupby(zip(names, widths, strict=True), key=lambda pair: pair[0]):
        wide = [each for _, each in members]
        parts.append(name.center(sum(wide) + len(wide) - 1))
    return " ".join(parts).rstrip()


def to_html(table: Table) -> str:
    """An HTML table with the title as its caption and the sentence below; every text is escaped."""
    columns = [column for column, _ in table.pairs]
    groups = groupby(columns, key=lambda column: column.group)
    above = "".join(f'<th colspan="{len(list(members))}">{escape(name)}</th>' for name, members in groups)
    heads = "".join(f'<th title="{escape(column.help)}">{escape(column.title)}</th>' for column in columns)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in table.cells(row)) + "</tr>\n" for row in table.rows
    )
    grouped = f"<tr>{above}</tr>" if any(column.group for column in columns) else ""
    return (
        f"<table>\n<caption>{escape(table.title)}</caption>\n<thead>{grouped}<tr>{heads}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody>\n</table>\n<p>{escape(table.sentence)}</p>\n"
    )
