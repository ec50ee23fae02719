"""Writers of tables: CSV and JSON for programs; text of a terminal, HTML, Markdown and LaTeX for people."""

import csv
import io
import json
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from itertools import groupby
from typing import Any

from .table import SHARE, Column, Table, Value

SUFFIXES = (".csv", ".json", ".md", ".tex")
_FORMULA = (
    "=",
    "+",
    "-",
    "@",
    "'",
)  # first characters of a text that a spreadsheet would run
_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "−": "$-$",
    "–": "--",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
    "\n": " ",
}
WIDTH = 80
_HEADING = 10  # columns of a heading; longer ones are broken between words
_LEAST = 8  # columns of a text that is folded
_NAME = 8  # more that the first column, of names, keeps
Lines = list[str]  # of a cell


def tables_text(suffix: str, shown: Sequence[Table], data: Table) -> str:
    """Content of a file with this suffix of `SUFFIXES`.

    CSV and JSON hold ``data``, with every column and a key for each; Markdown and LaTeX
    the tables that are ``shown``.
    """
    writers: dict[str, Callable[[], str]] = {
        ".csv": lambda: to_csv(data),
        ".json": lambda: to_json(data),
        ".md": lambda: "\n".join(
            f"**{table.title}**\n\n{to_markdown(table)}" for table in shown
        ),
        ".tex": lambda: "\n".join(map(to_latex, shown)),
    }
    return writers[suffix]()


def to_csv(table: Table) -> str:
    """CSV with units in its headings: an interval has two columns, and a spreadsheet takes no text for a formula."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    headings: list[str] = []
    for column in table.columns:
        unit = f" [{column.unit}]" if column.unit else ""
        ends = ("_low", "_high") if column.interval else ("",)
        headings += [f"{column.key}{end}{unit}" for end in ends]
    writer.writerow(headings)
    for row in table.rows:
        writer.writerow(
            [
                cell
                for column in table.columns
                for cell in _csv_cells(column, column.value(row))
            ]
        )
    return text.getvalue()


def _csv_cells(column: Column, value: Value) -> Sequence[Value]:
    if column.interval:
        return value if isinstance(value, tuple) else (None, None)
    if not isinstance(value, str):
        return (value,)
    text = " ".join(value.split())
    return (f"'{text}" if text.startswith(_FORMULA) else text,)


def to_json(table: Table) -> str:
    """JSON with title, sentence, columns and rows; null where a value is missing."""
    columns = [
        {
            "key": c.key,
            "heading": c.title,
            "unit": c.unit,
            "better": c.better,
            "help": c.help,
        }
        for c in table.columns
    ]
    about = {key: getattr(table, key) for key in ("name", "title", "sentence")}
    content = {**about, "columns": columns, "rows": table.records}
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def to_markdown(table: Table) -> str:
    """A Markdown table; texts are aligned left, numbers right."""
    columns = [column for column, _ in table.pairs]
    lines = [
        [_markdown(f"{column.group} {_heading(column)}".strip()) for column in columns],
        ["---" if table.is_text(column) else "--:" for column in columns],
        *([_markdown(cell) for cell in table.cells(row)] for row in table.rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _markdown(text: str) -> str:
    """Text that ends neither a cell nor a line."""
    return " ".join(text.split()).replace("\\", "\\\\").replace("|", "\\|")


def to_latex(table: Table) -> str:
    """A LaTeX table; it needs the package ``booktabs``."""
    columns = [column for column, _ in table.pairs]
    alignment = "".join("l" if table.is_text(column) else "r" for column in columns)
    lines = [
        r"\begin{table}",
        rf"\caption{{{_latex(table.title)}}}",
        rf"\begin{{tabular}}{{{alignment}}}",
        r"\toprule",
        *_latex_groups(columns),
        _latex_line([_heading(column) for column in columns]),
        r"\midrule",
        *(_latex_line(table.cells(row)) for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _latex_groups(columns: Sequence[Column]) -> list[str]:
    """The line of headings above groups of columns, with its rules; no line where there is no group."""
    if not any(column.group for column in columns):
        return []
    cells, rules, first = [], "", 1
    for group, members in groupby(columns, key=lambda column: column.group):
        count = len(list(members))
        cells.append(rf"\multicolumn{{{count}}}{{c}}{{{_latex(group)}}}")
        if group:
            rules += rf"\cmidrule(lr){{{first}-{first + count - 1}}}"
        first += count
    return [" & ".join(cells) + r" \\", rules]


def _latex_line(cells: Sequence[str]) -> str:
    return " & ".join(map(_latex, cells)) + r" \\"


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)


def _heading(column: Column) -> str:
    stated = column.unit in ("", SHARE) or f"({column.unit})" in column.group
    unit = "" if stated else f"({column.unit})"
    return " ".join(part for part in (column.title, unit, column.arrow) if part)


def to_text(table: Table, width: int = WIDTH) -> str:
    """Plain text with the title above and the sentence below, both wrapped at ``width``; see `table_lines`."""
    title, sentence = (
        textwrap.wrap(text, width) for text in (table.title, table.sentence)
    )
    return (
        "\n".join([*title, *(line for _, line in table_lines(table, width)), *sentence])
        + "\n"
    )


def table_lines(table: Table, width: int) -> Iterator[tuple[Any, str]]:
    """The lines of a table, each with its row; None above the first row.

    Intervals stand below their numbers. Where the table would be wider than ``width``,
    columns of texts are folded, the first one last; numbers are never cut off.
    """
    columns = [column for column, _ in table.pairs]
    if not columns:
        return
    heads = [_head_lines(column) for column in columns]
    cells = [[_cell(*pair, row) for pair in table.pairs] for row in table.rows]
    widths = [_width(of_column) for of_column in zip(heads, *cells, strict=True)]
    left = [place == 0 or table.is_text(column) for place, column in enumerate(columns)]
    free = [place for place, text in enumerate(left) if text]
    _groups(columns, widths)  # their names may need more width than their columns
    while sum(widths) + len(widths) - 1 > width and (
        wide := [place for place in free if widths[place] > _LEAST]
    ):
        widths[
            max(wide, key=lambda place: widths[place] - (_NAME if place == 0 else 0))
        ] -= 1
    for line in cells:
        for place in free:
            line[place] = [
                part for text in line[place] for part in _folded(text, widths[place])
            ]
    widths[0] = _width([heads[0], *(line[0] for line in cells)])
    height = max(map(len, heads))
    heads = [[""] * (height - len(head)) + head for head in heads]
    groups = _groups(columns, widths)
    for text in [
        *groups,
        *_block(heads, widths, left),
        "─" * (sum(widths) + len(widths) - 1),
    ]:
        yield None, text
    for row, line in zip(table.rows, cells, strict=True):
        yield from ((row, text) for text in _block(line, widths, left))


def _width(cells: Iterable[Lines]) -> int:
    return max(len(text) for cell in cells for text in cell)


def _head_lines(column: Column) -> Lines:
    words = textwrap.wrap(column.title, _HEADING, break_long_words=False)
    return column.title.split("\n") if "\n" in column.title else words or [""]


def _cell(column: Column, interval: Column | None, row: Any) -> Lines:
    ends = None if interval is None else interval.value(row)
    below = [" ".join(map(column.text, ends))] if isinstance(ends, tuple) else []
    return [*column.shown(row).split("\n"), *below]


def _folded(text: str, width: int) -> Lines:
    """Lines of a text, broken before a blank, an underscore or a hyphen where that is possible."""
    lines = [""]
    for part in re.findall(r"[ _-]*[^ _-]*", text):
        lines += (
            [part]
            if lines[-1] and len(lines[-1] + part) > width
            else [lines.pop() + part]
        )
    return [piece for line in lines for piece in textwrap.wrap(line, width)] or [""]


def _block(
    cells: Sequence[Lines], widths: Sequence[int], left: Sequence[bool]
) -> Iterator[str]:
    for at in range(max(map(len, cells), default=0)):
        texts = [cell[at] if at < len(cell) else "" for cell in cells]
        padded = [
            t.ljust(w) if first else t.rjust(w)
            for t, w, first in zip(texts, widths, left, strict=True)
        ]
        yield " ".join(padded).rstrip()


def _groups(columns: Sequence[Column], widths: list[int]) -> Lines:
    """The line of headings above groups of columns, none without a group; ``widths`` grow for long ones."""
    parts, first = [], 0
    for name, members in groupby(columns, key=lambda column: column.group):
        last = first + len(list(members))
        widths[last - 1] += max(
            0, len(name) - sum(widths[first:last]) - (last - first - 1)
        )
        parts.append(name.center(sum(widths[first:last]) + last - first - 1))
        first = last
    return [" ".join(parts).rstrip()] if any(column.group for column in columns) else []


def to_html(table: Table) -> str:
    """An HTML table with the title as its caption and the sentence below; every text is escaped."""
    columns = [column for column, _ in table.pairs]
    groups = groupby(columns, key=lambda column: column.group)
    above = "".join(
        f'<th colspan="{len(list(members))}">{escape(name)}</th>'
        for name, members in groups
    )
    heads = "".join(
        f'<th title="{escape(column.help)}">{escape(column.title)}</th>'
        for column in columns
    )
    rows = "".join(
        "<tr>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in table.cells(row))
        + "</tr>\n"
        for row in table.rows
    )
    grouped = f"<tr>{above}</tr>" if any(column.group for column in columns) else ""
    return (
        f"<table>\n<caption>{escape(table.title)}</caption>\n<thead>{grouped}<tr>{heads}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody>\n</table>\n<p>{escape(table.sentence)}</p>\n"
    )
