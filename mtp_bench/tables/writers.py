"""Writers of tables: CSV and JSON for programs, Markdown and LaTeX for people."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from itertools import groupby

from .table import SHARE, Column, Table, Value

SUFFIXES = (".csv", ".json", ".md", ".tex")
_FORMULA = ("=", "+", "-", "@", "'")  # first characters of a text that a spreadsheet would run
_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "−": "$-$", "–": "--", "↑": r"$\uparrow$",
    "↓": r"$\downarrow$", "\n": " ",
}  # fmt: skip


def tables_text(suffix: str, shown: Sequence[Table], data: Table) -> str:
    """Content of a file with this suffix of `SUFFIXES`.

    CSV and JSON hold ``data``, with every column and a key for each; Markdown and LaTeX the tables that are ``shown``.
    """
    writers: dict[str, Callable[[], str]] = {
        ".csv": lambda: to_csv(data),
        ".json": lambda: to_json(data),
        ".md": lambda: "\n".join(f"**{table.title}**\n\n{to_markdown(table)}" for table in shown),
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
        writer.writerow([cell for column in table.columns for cell in _csv_cells(column, column.value(row))])
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
        {"key": c.key, "heading": c.title, "unit": c.unit, "better": c.better, "help": c.help} for c in table.columns
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
