"""The page of the command line: what `--help` of every command says."""

from __future__ import annotations

from typing import Any

from .outputs import EXAMPLES

PAGE = "reference/commands.md"
HEAD = """\
# Commands

Every command has `--help`. Exit status: 0, 1 for a failure that the message explains, 2 for wrong usage.
What takes over two seconds shows its progress on the error stream: a bar in a terminal, else a line every ten seconds.
The library does so too, such as `compare` in a notebook. `MTP_BENCH_QUIET=1` switches it off.

## Example

From an agent to a picture of a moment when it lost an object:

```sh
{example}
```
"""


def page() -> str:
    """The page in Markdown."""
    head = HEAD.format(example=(EXAMPLES / "reference/commands.sh").read_text().strip())
    return "\n".join(
        [head, *(_section(name, command) for name, command in _commands())]
    )


def _commands() -> list[tuple[str, Any]]:
    """Names and commands; those of a group stand in place of the group."""
    from typer.main import get_command

    from mtp_bench.commands.app import app

    def walk(name: str, command: Any) -> list[tuple[str, Any]]:
        if not hasattr(command, "list_commands"):
            return [(name, command)]
        parts = [
            (part, command.get_command(None, part))
            for part in command.list_commands(None)
        ]
        return [
            entry
            for part, inner in parts
            for entry in walk(f"{name} {part}".strip(), inner)
        ]

    return walk("", get_command(app))


def _section(name: str, command: Any) -> str:
    """One command: what it does, its arguments and options."""
    import click

    context = click.Context(command, info_name=f"mtp-bench {name}")
    usage = " ".join([f"mtp-bench {name}", *command.collect_usage_pieces(context)])
    rows = [
        record
        for part in command.params
        if (record := _record(part, context)) is not None
    ]
    lines = [
        f"## mtp-bench {name}\n",
        _text(command.help or ""),
        "",
        f"```sh\n{usage}\n```\n",
    ]
    if rows:
        lines += ["| option | meaning |", "|---|---|"]
        lines += [f"| {_code(option)} | {_cell(text)} |" for option, text in rows]
    return "\n".join([*lines, ""])


def _record(part: Any, context: Any) -> tuple[str, str] | None:
    """Name and help text of a parameter; None if it is hidden."""
    if getattr(part, "hidden", False):
        return None
    record = part.get_help_record(context)
    return (
        record
        if record
        else (part.make_metavar(context), getattr(part, "help", "") or "")
    )


def _text(text: str) -> str:
    return text.replace("\b", "").strip()


def _code(text: str) -> str:
    return f"`{text.replace('|', chr(92) + '|')}`"


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())
