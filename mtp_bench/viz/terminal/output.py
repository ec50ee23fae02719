"""Tables and sentences on the output stream, progress on the error stream."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ...errors import MtpBenchError

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

PIPE_WIDTH = 180  # columns where the output is a file or a pipe


def show(content: RenderableType) -> None:
    """Print a listing, as wide as the terminal; a text as it is, without markup."""
    console = _console()
    text = isinstance(content, str)
    console.print(content, highlight=False, markup=not text, crop=False, soft_wrap=text and not console.is_terminal)


def show_numbers(table: Table, console: Console | None = None) -> None:
    """Print a table of results: where the terminal is too narrow for it, its lines wrap, but no number is cut off."""
    console = console or _console()
    needed = console.measure(table, options=console.options.update(max_width=10 * PIPE_WIDTH)).maximum
    console.width = max(console.width, needed)
    console.print(table, highlight=False)


@contextmanager
def progress_bar(label: str) -> Iterator[tuple[Callable[[int], None], Callable[[str], None]]]:
    """A progress bar: ``started(total)`` and ``done(scene)`` drive it; it shows on the error stream, on a terminal.

    An interruption becomes an error of one line: the commands write when the work is done, each file as a whole.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(label, total=None)
        try:
            yield (
                lambda total: progress.update(task, total=total),
                lambda scene: progress.update(task, advance=1, description=f"{label} {scene}"),
            )
        except KeyboardInterrupt:
            raise MtpBenchError("interrupted; nothing was written") from None


def _console() -> Console:
    from rich.console import Console

    return Console() if sys.stdout.isatty() else Console(width=PIPE_WIDTH)
