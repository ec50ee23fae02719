"""Files of a study: every table as CSV and JSON, every figure as SVG and PNG, and the page."""

from __future__ import annotations

import shutil
from pathlib import Path

from ..errors import MtpBenchError
from ..files import make_folder, require_folder, write_bytes, write_text
from ..parallel import Done
from .figures import make_figures
from .findings import Findings
from .gallery import gallery
from .page import study_page
from .runs import RUNS
from .table import Table

TABLES, FIGURES, EVENTS, PAGE = "tables", "figures", "events", "index.html"
_MARK = ".study"  # in every folder that a study was written into


def require_study_folder(folder: Path) -> None:
    """Raise MtpBenchError unless ``folder`` is new, holds runs alone or is a study's, whose files are written anew."""
    require_folder(folder)
    if not folder.is_dir() or (folder / _MARK).is_file():
        return
    other = sorted(path.name for path in folder.iterdir() if path.name != RUNS and path.name[0] != ".")
    if other:
        raise MtpBenchError(f"{folder} holds {other[0]!r}, which is of no study: choose another folder with -o")


def write_study(folder: Path, found: Findings, tables: dict[str, Table], command: str, done: Done) -> int:
    """Write everything; how many figures. ``command``: that makes the study again. ``done`` is told what is written."""
    (folder / _MARK).touch()
    for name in (TABLES, FIGURES, EVENTS):  # of an earlier study, which may have had others
        shutil.rmtree(folder / name, ignore_errors=True)
    make_folder(folder / TABLES)
    for table in tables.values():
        write_text(folder / TABLES / f"{table.name}.csv", table.to_csv())
        write_text(folder / TABLES / f"{table.name}.json", table.to_json())
    make_folder(folder / FIGURES)
    figures = make_figures(found, tables)
    for figure in figures.values():
        write_text(folder / FIGURES / f"{figure.name}.svg", figure.svg_file)
        write_bytes(folder / FIGURES / f"{figure.name}.png", figure.png)
    done("figures")
    pictures = gallery(found)
    if pictures:
        make_folder(folder / EVENTS)
    for picture in pictures:
        write_text(folder / EVENTS / f"{picture.figure.name}.svg", picture.figure.svg_file)
        write_bytes(folder / EVENTS / f"{picture.figure.name}.png", picture.figure.png)
        write_bytes(folder / EVENTS / f"{picture.figure.name}-focus.png", picture.focus)
    done("pictures of events")
    write_text(folder / PAGE, study_page(found, tables, figures, pictures, command))
    done("page")
    return len(figures)
