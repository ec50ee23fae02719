"""Command groups that import a command when it is used, so that ``--help`` starts at once."""

from __future__ import annotations

import importlib
import keyword
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup
from typer.main import get_command


class LazyGroup(TyperGroup):
    """A group whose command ``x-y`` is the function, or the group, ``x_y`` of the module ``mtp_bench.commands.x_y``."""

    summaries: ClassVar[dict[str, str]] = {}  # command -> its line in ``--help`` of the group

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        names: Any = dict.fromkeys(self.summaries)
        self.commands = names  # typer takes its suggestions for a misspelt name from here

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all commands, in the order of ``--help``."""
        return list(self.summaries)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command, imported now; None for an unknown name."""
        if cmd_name not in self.summaries:
            return None
        name = cmd_name.replace("-", "_") + "_" * keyword.iskeyword(cmd_name)
        content = getattr(importlib.import_module(f"mtp_bench.commands.{name}"), name)
        if isinstance(content, typer.Typer):
            return get_command(content)
        from .options import Command, opened

        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        alone.command(cmd_name, cls=Command)(opened(content))
        return get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names and summaries without importing a command."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self.summaries.items()))
