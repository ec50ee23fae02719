"""Writers of tables.

CSV and JSON are for programs; text of a terminal, HTML, Markdown and LaTeX for people.
"""

import csv
import io
import json
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import groupby, zip_longest
from typing import Any

from .table import SHARE, Column, Table, Value, interval_texts

TABLE_SUFFIXES = (".csv", ".json", ".md", ".tex")
# first characters of a text that a spreadsheet would run
_FORMULA = ("=", "+", "-", "@", "'")
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
_MAX_HEADING = 10  # columns of a heading; longer ones are broken between words
_MIN_TEXT = 8  # columns of a text that is folded
_NAME_BONUS = 8  # more columns that the first column, of names, keeps
Lines = list[str]  # of a cell


def tables_text(suffix: str, shown: Sequence[Table], data: Table) -> str:
    """Return the content of a file with this suffix of `TABLE_SUFFIXES`.

    CSV and JSON hold ``data``, with every column and a key for each; Markdown and LaTeX
    the tables that are ``shown``.
    """
    match suffix:
        case ".csv":
            return to_csv(data)
        case ".json":
            return to_json(data)
        case ".md":
            parts = [f"**{table.title}**\n\n{to_markdown(table)}" for table in shown]
            return "\n".join(parts)
        case _:
            return "\n".join(map(to_latex, shown))


def to_csv(table: Table) -> str:
    """Return a table as CSV, with units in the headings.

    An interval has two columns, and a spreadsheet takes no text for a formula.
    """
    headings: list[str] = []
    for column in table.columns:
        unit = f" [{column.unit}]" if column.unit else ""
        ends = ("_low", "_high") if column.interval else ("",)
        headings += [f"{column.key}{end}{unit}" for end in ends]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    for row in table.rows:
        cells: list[Value] = []
        for column in table.columns:
            cells += _csv_cells(column, column.value(row))
        writer.writerow(cells)
    return text.getvalue()


def _csv_cells(column: Column, value: Value) -> Sequence[Value]:
    if column.interval:
        return value if isinstance(value, tuple) else (None, None)
    if not isinstance(value, str):
        return (value,)
    text = " ".join(value.split())
    if text.startswith(_FORMULA):
        text = f"'{text}"
    return (text,)


def to_json(table: Table) -> str:
    """Return a table as JSON: title, sentence, columns and rows.

    A missing value is null.
    """
    columns = [
        {
            "key": column.key,
            "heading": column.title,
            "unit": column.unit,
            "better": column.better,
            "help": column.help,
        }
        for column in table.columns
    ]
    content = {
        "name": table.name,
        "title": table.title,
        "sentence": table.sentence,
        "columns": columns,
        "rows": table.records,
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def to_markdown(table: Table) -> str:
    """Return a table in Markdown.

    Texts are aligned left, numbers right.
    """
    columns = [column for column, _ in table.pairs]
    heads = [f"{column.group} {_heading(column)}".strip() for column in columns]
    lines = [
        [_markdown(head) for head in heads],
        ["---" if table.is_text(column) else "--:" for column in columns],
    ]
    for row in table.rows:
        lines.append([_markdown(cell) for cell in table.cells(row)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _markdown(text: str) -> str:
    """Return text that ends neither a cell nor a line."""
    return " ".join(text.split()).replace("\\", "\\\\").replace("|", "\\|")


def to_latex(table: Table) -> str:
    """Return a table in LaTeX.

    It needs the package ``booktabs``.
    """
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


def _group_widths(columns: Sequence[Column]) -> list[tuple[str, int]]:
    """Return the headings above groups of columns, and their numbers of columns."""
    groups = groupby(columns, key=lambda column: column.group)
    return [(name, len(list(members))) for name, members in groups]


def _latex_groups(columns: Sequence[Column]) -> list[str]:
    """Return the line of headings above groups, with its rules.

    Empty without groups.
    """
    if not any(column.group for column in columns):
        return []
    cells = []
    rules = ""
    first = 1
    for name, count in _group_widths(columns):
        cells.append(rf"\multicolumn{{{count}}}{{c}}{{{_latex(name)}}}")
        if name:
            rules += rf"\cmidrule(lr){{{first}-{first + count - 1}}}"
        first += count
    return [" & ".join(cells) + r" \\", rules]


def _latex_line(cells: Sequence[str]) -> str:
    return " & ".join(map(_latex, cells)) + r" \\"


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)


def _heading(column: Column) -> str:
    parts = [column.title]
    in_group = f"({column.unit})" in column.group
    if column.unit not in ("", SHARE) and not in_group:
        parts.append(f"({column.unit})")
    if column.arrow:
        parts.append(column.arrow)
    return " ".join(parts)


def to_text(table: Table, width: int = WIDTH) -> str:
    """Return plain text, the title above and the sentence below.

    Both are wrapped at ``width``; see `table_lines`.
    """
    lines = textwrap.wrap(table.title, width)
    lines += [line for _, line in table_lines(table, width)]
    lines += textwrap.wrap(table.sentence, width)
    return "\n".join(lines) + "\n"


def table_lines(table: Table, width: int) -> Iterator[tuple[Any, str]]:
    """Yield (row, line) for each line of a table.

    Lines of the heading come with None. Intervals stand below their numbers. Where
    the table would be wider than ``width``, columns of texts are folded, beginning with
    the last one. Numbers are never cut off.
    """
    columns = [column for column, _ in table.pairs]
    if not columns:
        return
    heads = list(map(_head_lines, columns))
    cells = [[_cell(*pair, row) for pair in table.pairs] for row in table.rows]
    is_left = [place == 0 or table.is_text(c) for place, c in enumerate(columns)]
    widths = _fit(columns, heads, cells, is_left, width)
    for text in _lines_above(columns, heads, widths, is_left):
        yield None, text
    for row, row_cells in zip(table.rows, cells, strict=True):
        for text in _block(row_cells, widths, is_left):
            yield row, text


def _lines_above(
    columns: Sequence[Column],
    heads: Sequence[Lines],
    widths: list[int],
    is_left: Sequence[bool],
) -> Iterator[str]:
    """Yield headings of groups and columns, and the line below them."""
    group_line = _group_line(columns, widths)
    if any(column.group for column in columns):
        yield group_line
    height = max(map(len, heads))
    yield from _block(
        [[""] * (height - len(head)) + head for head in heads], widths, is_left
    )
    yield "─" * _total(widths)


def _fit(
    columns: Sequence[Column],
    heads: Sequence[Lines],
    cells: Sequence[list[Lines]],
    is_left: Sequence[bool],
    width: int,
) -> list[int]:
    """Fold texts until the table fits, and return the widths of columns.

    ``cells`` are folded in place.
    """
    widths = [_width(column) for column in zip(heads, *cells, strict=True)]
    _group_line(columns, widths)  # names of groups may need more width than columns
    folded = [place for place, is_text in enumerate(is_left) if is_text]
    _narrow(widths, folded, width)
    for row_cells in cells:
        for place in folded:
            row_cells[place] = _fold(row_cells[place], widths[place])
    # names may fold to less than their width
    widths[0] = _width([heads[0], *(row_cells[0] for row_cells in cells)])
    return widths


def _total(widths: Sequence[int]) -> int:
    """Return the width of columns with a blank between them."""
    return sum(widths) + len(widths) - 1


def _narrow(widths: list[int], folded: Sequence[int], width: int) -> None:
    """Narrow the ``folded`` columns, in place, until the table fits."""
    while _total(widths) > width:
        wide = [place for place in folded if widths[place] > _MIN_TEXT]
        if not wide:
            return
        # the widest is narrowed; the column of names counts as less wide
        counted_width = {place: widths[place] for place in wide}
        if 0 in counted_width:
            counted_width[0] -= _NAME_BONUS
        widths[max(wide, key=counted_width.__getitem__)] -= 1


def _width(cells: Iterable[Lines]) -> int:
    return max(len(text) for cell in cells for text in cell)


def _head_lines(column: Column) -> Lines:
    if "\n" in column.title:
        return column.title.split("\n")
    lines = textwrap.wrap(column.title, _MAX_HEADING, break_long_words=False)
    return lines or [""]


def _cell(column: Column, interval: Column | None, row: Any) -> Lines:
    lines = column.shown(row).split("\n")
    ends = interval_texts(column, interval, row)
    if ends:
        lines.append(" ".join(ends))
    return lines


def _fold(cell: Lines, width: int) -> Lines:
    """Break the lines of a cell, before a separator if possible."""
    folded: Lines = []
    for text in cell:
        lines = [""]
        for word in re.findall(r"[ _-]*[^ _-]*", text):
            if lines[-1] and len(lines[-1] + word) > width:
                lines.append(word)
            else:
                lines[-1] += word
        wrapped: Lines = []
        for line in lines:
            wrapped += textwrap.wrap(line, width)
        folded += wrapped or [""]
    return folded


def _block(
    cells: Sequence[Lines], widths: Sequence[int], is_left: Sequence[bool]
) -> Iterator[str]:
    """Yield the lines of cells beside each other."""
    for texts in zip_longest(*cells, fillvalue=""):
        aligned = [
            text.ljust(width) if to_left else text.rjust(width)
            for text, width, to_left in zip(texts, widths, is_left, strict=True)
        ]
        yield " ".join(aligned).rstrip()


def _group_line(columns: Sequence[Column], widths: list[int]) -> str:
    """Return the line of headings above groups.

    ``widths`` grow in place for long ones.
    """
    parts = []
    first = 0
    for name, count in _group_widths(columns):
        end = first + count
        lacking = len(name) - _total(widths[first:end])
        widths[end - 1] += max(0, lacking)
        parts.append(name.center(_total(widths[first:end])))
        first = end
    return " ".join(parts).rstrip()


def to_html(table: Table) -> str:
    """Return a table in HTML, with title and sentence.

    Every text is escaped.
    """
    columns = [column for column, _ in table.pairs]
    groups = ""
    if any(column.group for column in columns):
        names = "".join(
            f'<th colspan="{count}">{escape(name)}</th>'
            for name, count in _group_widths(columns)
        )
        groups = f"<tr>{names}</tr>"
    heads = "".join(
        f'<th title="{escape(column.help)}">{escape(column.title)}</th>'
        for column in columns
    )
    rows = ""
    for row in table.rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in table.cells(row))
        rows += f"<tr>{cells}</tr>\n"
    return (
        f"<table>\n<caption>{escape(table.title)}</caption>\n"
        f"<thead>{groups}<tr>{heads}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody>\n</table>\n<p>{escape(table.sentence)}</p>\n"
    )
