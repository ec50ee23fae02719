"""Options of what is shown of a report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from typer import Option

from ..core import Table
from ..scoring import KNOWN_SUBSETS, Report, main_table
from ..viz import chosen_table, column_keys, data_table
from .options import TableOption, one_of


def words(*names: str, known: Callable[[], Sequence[str]], text: str) -> Any:
    """An option that takes words of ``known`` with commas between them; ``text``: its help."""

    def check(value: str | None) -> str | None:
        for word in value.split(",") if value is not None else ():
            one_of(word, known())
        return value

    return Option(*names, help=text, callback=check)


@dataclass(frozen=True)
class Shown:
    """Options of the shown tables of a report, and the file that they are written to."""

    full: Annotated[
        bool,
        Option(
            "--full",
            help="All settings and controls, parts of bADE, conditions and further tables.",
        ),
    ] = False
    table_file: TableOption = None
    columns: Annotated[
        str | None,
        words(
            "--columns",
            known=column_keys,
            text="Columns of the table, keys of --json with commas between them.",
        ),
    ] = None
    subsets: Annotated[
        str | None,
        words(
            "--subsets",
            known=lambda: KNOWN_SUBSETS,
            text="Subsets of the table, such as all,ids; with --columns.",
        ),
    ] = None

    @property
    def is_full(self) -> bool:
        """True if more is asked for than the main table on the screen."""
        return self.full or any(
            part is not None for part in (self.table_file, self.columns, self.subsets)
        )

    def main(self, report: Report) -> Table:
        """The first table: of the chosen columns and subsets, if there are any."""
        if self.columns is None and self.subsets is None:
            return main_table(report)
        columns = (self.columns or "error,interval,minADE,minFDE").split(",")
        chosen = (self.subsets or "all,ids").split(",")
        return chosen_table(
            report,
            columns,
            [subset for subset in KNOWN_SUBSETS if subset in chosen],
            self.full,
        )

    def data(self, report: Report) -> Table:
        """The table of files for programs: every number, or those that are chosen."""
        return (
            data_table(report)
            if self.columns is None and self.subsets is None
            else self.main(report)
        )
