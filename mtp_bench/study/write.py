"""Files of a study: every table as CSV and JSON, every figure as SVG and PNG, and the page."""

from __future__ import annotations

from pathlib import Path

from ..files import make_folder, write_bytes, write_text
from .figures import make_figures
from .findings import Findings
from .table import Table

TABLES, FIGURES, PAGE = "tables", "figures", "index.html"


def write_study(folder: Path, found: Findings, tables: dict[str, Table]) -> Path:
    """Write everything; the path of the page."""
    make_folder(folder / TABLES)
    for table in tables.values():
        write_text(folder / TABLES / f"{table.name}.csv", table.to_csv())
        write_text(folder / TABLES / f"{table.name}.json", table.to_json())
    make_folder(folder / FIGURES)
    figures = make_figures(found, tables)
    for figure in figures.values():
        write_text(folder / FIGURES / f"{figure.name}.svg", figure.svg_file)
        write_bytes(folder / FIGURES / f"{figure.name}.png", figure.png)
    return folder / PAGE
