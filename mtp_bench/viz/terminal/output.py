"""Tables and sentences on the output stream."""

from __future__ import annotations

import shlex
import sys
import textwrap
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ...tables import Column
from ...tables import Table as Data

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

PIPE_WIDTH = 180  # columns where the output is a file or a pipe
TEXT_WIDTH = 80  # columns of reports
NAME_WIDTH = 15  # columns of the first column of a report's table; longer names are folded
SCENE_WIDTH = 20  # of names of scenes, so that those of the simulated ones can be copied in one piece
HEADING_WIDTH = 10  # columns of a heading; longer ones are broken between words


def report_table(
    data: Data,
    style: Callable[[Any], str] | None = None,
    first_width: int | None = NAME_WIDTH,
    wrapped: Collection[str] = (),
) -> Table:
    """A table without borders, of at most TEXT_WIDTH columns where its cells are short.

    Intervals stand below their numbers. Texts of the first column are folded at ``first_width``, those of the columns
    with the keys ``wrapped`` where the terminal ends. ``style``: rich's style of a row.
    """
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(
        title=escape(data.title), title_justify="left", title_style="bold", header_style="", box=box.SIMPLE_HEAD,
        show_edge=False, padding=0,
    )  # fmt: skip
    pairs = data.pairs
    headings = _headings([column for column, _ in pairs])
    for place, ((column, _), heading) in enumerate(zip(pairs, headings, strict=True)):
        justify = "left" if place == 0 or data.is_text(column) else "right"
        whole = place > 0 and column.key not in wrapped
        table.add_column(heading, justify=justify, no_wrap=whole, overflow="fold")  # type: ignore[arg-type]
    if table.columns:
        table.columns[0].max_width = first_width
    for row in data.rows:
        cells = [escape(_cell(column, interval, row)) for column, interval in pairs]
        table.add_row(*cells, style=style(row) if style else "")
    return table


def _cell(column: Column, interval: Column | None, row: Any) -> str:
    ends = None if interval is None else interval.value(row)
    below = f"\n{column.text(ends[0])} {column.text(ends[1])}" if isinstance(ends, tuple) else ""
    return column.shown(row) + below


def _headings(columns: Sequence[Column]) -> list[str]:
    """Headings of equally many lines; above the first of a group its name."""
    lines = []
    for before, column in zip([None, *columns], columns, strict=False):
        group = column.group if before is None or before.group != column.group else ""
        wrapped = textwrap.wrap(column.title, HEADING_WIDTH, break_long_words=False)
        words = column.title.split("\n") if "\n" in column.title else wrapped
        lines.append([*([group] if column.group else []), *words])
    height = max(map(len, lines), default=0)
    return ["\n".join([*[""] * (height - len(each)), *each]) for each in lines]


def counted(number: int | None, noun: str, plural: str = "s") -> str:
    """A number with its noun, "1 event" or "2 events"; None gives "unknown events"."""
    return f"{'unknown' if number is None else number} {noun}{'' if number == 1 else plural}"


def show(content: RenderableType) -> None:
    """Print a listing as wide as the terminal, or a text unchanged, without markup."""
    console = _console()
    text = isinstance(content, str)
    console.print(content, highlight=False, markup=not text, crop=False, soft_wrap=text and not console.is_terminal)


def show_lines(texts: Iterable[str], sign: str = "") -> None:
    """Print texts of a report in lines of at most TEXT_WIDTH columns, each with a ``sign`` before it."""
    for text in texts:
        lines = textwrap.wrap(text, TEXT_WIDTH, initial_indent=sign, subsequent_indent=" " * len(sign))
        show("\n".join(lines))


def command_line(*words: str, **options: object) -> str:
    """The command ``mtp-bench`` of these words and of the options that are not None; it can be pasted into a shell."""
    given = [part for name, value in options.items() if value is not None for part in (f"--{name}", str(value))]
    return shlex.join(["mtp-bench", *words, *given])


def show_command(words: str) -> None:
    """Print a command as one line that can be pasted, however long it is."""
    _console().print(words, highlight=False, markup=False, crop=False, soft_wrap=True)


def show_table(data: Data, console: Console | None = None, **layout: Any) -> None:
    """Print a table with the ``layout`` of `report_table`; no number is cut off, however narrow the terminal is."""
    console, table = console or _console(), report_table(data, **layout)
    widest = console.options.update(max_width=10 * PIPE_WIDTH)
    console.width = max(console.width, console.measure(table, options=widest).minimum)
    console.print(table, highlight=False)


def _console() -> Console:
    from rich.console import Console

    # No emoji: ":x:" in a name is a name, and commands are pasted.
    return Console(emoji=False) if sys.stdout.isatty() else Console(emoji=False, width=PIPE_WIDTH)
