"""Tables of a report that a command shows, and their options."""

import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Option

from ..core import Table, to_text
from ..running import skipped_line
from ..scoring import KNOWN_SUBSETS, Report, Subset, main_table
from ..viz import (
    chosen_table,
    column_keys,
    data_table,
    full_tables,
    notes,
    short_verdict,
    show,
    show_lines,
    verdict,
    warnings,
)
from .options import TableOption, choice
from .output import write_table

# of --columns and --subsets, if only the other one is given
_DEFAULT_COLUMNS = "error,interval,minADE,minFDE"
_DEFAULT_SUBSETS = "all,ids"


@dataclass(frozen=True)
class Shown:
    """Options of the tables of a report, and the file that they are written to."""

    full: Annotated[
        bool,
        Option(
            "--full",
            help="All settings and controls, parts of bADE, conditions and "
            "further tables.",
        ),
    ] = False
    table_file: TableOption = None
    columns: Annotated[
        str | None,
        choice(
            column_keys(),
            "--columns",
            several=True,
            text="Columns of the table, keys of --json with commas between them.",
        ),
    ] = None
    subsets: Annotated[
        str | None,
        choice(
            KNOWN_SUBSETS,
            "--subsets",
            several=True,
            text="Subsets of the table, such as all,ids; with --columns.",
        ),
    ] = None

    @property
    def is_full(self) -> bool:
        """True if more is asked for than the main table on the screen."""
        return self.full or self.table_file is not None or self._are_chosen

    @property
    def _are_chosen(self) -> bool:
        return self.columns is not None or self.subsets is not None

    def main(self, report: Report) -> Table:
        """Return the first table: of the chosen columns and subsets, if any."""
        if not self._are_chosen:
            return main_table(report)
        columns = (self.columns or _DEFAULT_COLUMNS).split(",")
        chosen = (self.subsets or _DEFAULT_SUBSETS).split(",")
        subsets: list[Subset] = [name for name in KNOWN_SUBSETS if name in chosen]
        return chosen_table(report, columns, subsets, self.full)

    def data(self, report: Report) -> Table:
        """Return the table of files for programs: every number, or the chosen ones."""
        return self.main(report) if self._are_chosen else data_table(report)


def show_report(
    report: Report,
    title: str,
    skipped: Mapping[str, int],
    shown: Shown,
    names: Sequence[str] = (),
) -> None:
    """Print the main table of a report, its verdict and warnings.

    With ``full`` everything is printed. ``title``: what the report is of. ``names``:
    submissions that the verdict is about; a report of one agent has none.
    """
    main = shown.main(report)
    other_tables = list(full_tables(report)) if shown.full else []
    write_table(shown.table_file, [main, *other_tables], shown.data(report))
    show(to_text(main).rstrip())
    condition = report.condition
    lines: list[str | None] = [short_verdict(report, names), *warnings(report)]
    lines += [condition.get("trained"), skipped_line(skipped)]
    show_lines(filter(None, lines))
    if not shown.full:
        show_lines([_next_step()])
        return
    show("")
    show_lines(verdict(report, names), "- ")
    show_lines(notes(report))
    data = f"split {condition['split']}, {condition['detections']}"
    show_lines([f"{title}; {data}; truth: {condition['truth']}", condition["weights"]])
    for table in other_tables:
        show("\n" + to_text(table).rstrip())


def _next_step() -> str:
    """Return one line that says where to go next.

    Where a shell would not find ``mtp-bench``, it says how to activate its environment.
    """
    activate = Path(sys.executable).with_name("activate")
    is_here = activate.is_file() and activate.is_relative_to(Path.cwd())
    if shutil.which("mtp-bench") or not is_here:
        return "Parts, other settings and conditions: --full"
    return (
        f"Next: source {activate.relative_to(Path.cwd())}; mtp-bench --help. "
        "Parts and conditions: --full"
    )
