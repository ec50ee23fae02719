"""Tables of a report that a command shows, and their options."""

import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Option

from ..core import to_text
from ..running import skipped_line
from ..scoring import Report, main_table
from ..viz import (
    cost_lines,
    data_table,
    full_tables,
    notes,
    paired_table,
    show,
    show_lines,
    verdict,
    warnings,
)
from .options import TableOption
from .output import write_table


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

    @property
    def is_full(self) -> bool:
        """True if more is asked for than the main table on the screen."""
        return self.full or self.table_file is not None


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
    main = main_table(report)
    other_tables = list(full_tables(report)) if shown.full else []
    write_table(shown.table_file, [main, *other_tables], data_table(report))
    show(to_text(main).rstrip())
    condition = report.condition
    lines: list[str | None] = [verdict(report, names), *warnings(report)]
    lines += [condition.get("trained"), skipped_line(skipped)]
    show_lines(filter(None, lines))
    if not shown.full:
        show_lines([_next_step()])
        return
    show("")
    show_lines(cost_lines(report))
    show_lines(notes(report))
    data = f"split {condition['split']}, {condition['detections']}"
    show_lines([f"{title}; {data}; truth: {condition['truth']}", condition["weights"]])
    for table in other_tables:
        show("\n" + to_text(table).rstrip())


def show_differences(report: Report, shown: Shown) -> None:
    """Print the differences of agents, which ``full`` prints with all tables."""
    if report.paired and not shown.full:
        show("\n" + to_text(paired_table(report)).rstrip())
    samples = {row.samples for row in report.rows}
    if len(samples) > 1:
        advice = f"--samples {min(samples)} cuts all alike"
        numbers = " and ".join(map(str, sorted(samples)))
        show_lines([f"Rows of {numbers} samples are not compared: {advice}"])


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
