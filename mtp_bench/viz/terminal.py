"""Tables and sentences on the output stream."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

PIPE_WIDTH = 180  # columns where the output is a file or a pipe


def show(content: RenderableType) -> None:
    """Print a listing, as wide as the terminal; a text as it is, without markup."""
    console = _console()
    text = isinstance(content, str)
    console.print(content, highlight=False, markup=not text, soft_wrap=text and not console.is_terminal)


def show_numbers(table: Table, console: Console | None = None) -> None:
    """Print a table of results: where the terminal is too narrow for it, its lines wrap, but no number is cut off."""
    console = console or _console()
    needed = console.measure(table, options=console.options.update(max_width=10 * PIPE_WIDTH)).maximum
    console.width = max(console.width, needed)
    console.print(table, highlight=False)


def _console() -> Console:
    from rich.console import Console

    return Console() if sys.stdout.isatty() else Console(width=PIPE_WIDTH)
