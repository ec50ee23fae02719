"""The leaderboard as a short table per environment for the terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..terminal.output import NOTHING, new_table, number
from .columns import COLUMNS, shown
from .entries import Entry, by_env, silence_of

if TYPE_CHECKING:
    from rich.table import Table

_SHOWN = ("ids", "reacquired", "gap", "p95")


def board_tables(entries: Sequence[Entry]) -> list[Table]:
    """A table per environment, the best first."""
    return [_table(env_id, listed) for env_id, listed in by_env(entries).items()]


def _table(env_id: str, entries: Sequence[Entry]) -> Table:
    from rich.markup import escape

    columns = [column for column in COLUMNS if column.key in _SHOWN]
    silence = silence_of(entries)
    said = "" if silence is None else f"; saying nothing scores {silence:.3f}"
    title = f"{escape(env_id)}: error at the false-forecast budgets (m){said}"
    numbers = ("error ↓ [dim]95 % interval[/dim]", *(f"{column.label} {column.arrow}".strip() for column in columns))
    words = ("submission", "verified", "not ranked because")
    headings = ("rank", words[0], *numbers, *words[1:])
    table = new_table(title, headings, left=words, whole=(words[0], *numbers))
    for entry in entries:
        bounds = entry.interval
        style = "bold green" if entry.added else "" if entry.compared else "dim"
        table.add_row(
            NOTHING if entry.rank is None else str(entry.rank),
            escape(printable(entry.name)) + (" (added)" if entry.added else ""),
            number(entry.error) + ("" if bounds is None else f" \\[{bounds[0]:.3f}, {bounds[1]:.3f}]"),
            *(shown(column, entry) for column in columns),
            entry.record.verification,
            escape(printable(entry.why)),
            style=style,
        )
    return table


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Any]]]:
    """What the tables show: a list of rows per environment, None where nothing is known."""
    return {env_id: [_row(entry) for entry in listed] for env_id, listed in by_env(entries).items()}


def _row(entry: Entry) -> dict[str, Any]:
    kept = ("division", "verification", "status", "made", "digest")
    return {
        "rank": entry.rank,
        "submission": entry.name,
        "not_ranked_because": entry.why or None,
        "added": entry.added,
        "interval": list(entry.interval) if entry.interval else None,
        **{column.key: column.value(entry) for column in COLUMNS},
        **{name: getattr(entry.record, name) for name in kept},
    }


def printable(text: str) -> str:
    """``text`` without characters that would steer the terminal."""
    return "".join(character if character.isprintable() else "�" for character in text)
