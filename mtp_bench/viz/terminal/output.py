"""Tables and sentences on the output stream."""

import shlex
import sys
import textwrap
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from ...core import Table, clean_text, counted as counted, table_lines

if TYPE_CHECKING:
    from rich.console import Console

PIPE_WIDTH = 180  # columns where the output is a file or a pipe
TEXT_WIDTH = 80  # columns of reports


def show(text: str) -> None:
    """Print a text unchanged, without markup.

    A terminal wraps it.
    """
    console = _console()
    console.print(text, crop=False, soft_wrap=not console.is_terminal)


def show_lines(texts: Iterable[str], sign: str = "") -> None:
    """Print texts in lines of TEXT_WIDTH columns, each behind ``sign``."""
    indent = " " * len(sign)
    for text in texts:
        lines = textwrap.wrap(
            clean_text(text, len(text) + 1),
            TEXT_WIDTH,
            initial_indent=sign,
            subsequent_indent=indent,
        )
        show("\n".join(lines))


def command_line(*words: str, **options: object) -> str:
    """Return a command of ``mtp-bench`` for a shell, without missing options."""
    arguments = ["mtp-bench", *words]
    for name, value in options.items():
        if value is not None:
            arguments += [f"--{name}", str(value)]
    return shlex.join(arguments)


def show_command(words: str) -> None:
    """Print a command as one line that can be pasted."""
    _console().print(words, soft_wrap=True)


def show_table(
    data: Table,
    console: "Console | None" = None,
    style: Callable[[Any], str] | None = None,
) -> None:
    """Print a table at the width of the terminal.

    ``style``: rich's style of a row.
    """
    console = console or _console()
    console.print(data.title, style="bold")
    for row, line in table_lines(data, console.width):
        row_style = "" if style is None or row is None else style(row)
        console.print(line, style=row_style, soft_wrap=True)


def _console() -> "Console":
    """Return a console that shows texts as they are.

    ":x:" and "[red]" in a name are neither emoji nor markup, and commands are pasted.
    """
    from rich.console import Console

    width = None if sys.stdout.isatty() else PIPE_WIDTH
    return Console(emoji=False, markup=False, highlight=False, width=width)
