"""The leaderboard as a short table per environment for the terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .columns import COLUMNS, NOTHING, shown
from .entries import Entry, Row, by_env, silence_of

if TYPE_CHECKING:
    from rich.table import Table

_SHOWN = ("ids", "frag", "gap", "p95")


def board_tables(entries: Sequence[Entry]) -> list[Table]:
    """A table per environment, the best first."""
    return [_table(env_id, listed) for env_id, listed in by_env(entries).items()]


def _table(env_id: str, entries: Sequence[Entry]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    columns = [column for column in COLUMNS if column.key in _SHOWN]
    silence = silence_of(entries)
    said = "" if silence is None else f"; saying nothing scores {silence:.3f}"
    table = Table(title=f"{escape(env_id)}: missing-aware error (m){said}", title_justify="left")
    table.add_column("rank", justify="right")
    table.add_column("submission", no_wrap=True)
    table.add_column("error ↓ [dim]95 % interval[/dim]", justify="right", no_wrap=True)
    for column in columns:
        table.add_column(f"{column.label} {column.arrow}".strip(), justify="right", no_wrap=True)
    table.add_column("verified")
    table.add_column("not ranked because")
    for entry in entries:
        style = "bold green" if entry.added else "dim" if entry.rank is None else ""
        table.add_row(
            NOTHING if entry.rank is None else str(entry.rank),
            escape(printable(entry.name)) + (" (added)" if entry.added else ""),
            _error(entry),
            *(shown(column, entry) for column in columns),
            str(entry.record.get("verification") or NOTHING),
            escape(printable(entry.why)),
            style=style,
        )
    return table


def board_json(entries: Sequence[Entry]) -> dict[str, list[Row]]:
    """What the tables show: a list of rows per environment, None where nothing is known."""
    return {env_id: [_row(entry) for entry in listed] for env_id, listed in by_env(entries).items()}


def _row(entry: Entry) -> Row:
    record = entry.record
    kept = ("division", "verification", "status", "made", "digest")
    return {
        "rank": entry.rank,
        "submission": entry.name,
        "not_ranked_because": entry.why or None,
        "added": entry.added,
        "interval": list(entry.interval) if entry.interval else None,
        **{column.key: column.value(entry) for column in COLUMNS},
        **{name: record.get(name) for name in kept},
    }


def _error(entry: Entry) -> str:
    if entry.error is None:
        return NOTHING
    if entry.interval is None:
        return f"{entry.error:.3f}"
    return f"{entry.error:.3f} \\[{entry.interval[0]:.3f}, {entry.interval[1]:.3f}]"


def printable(text: Any) -> str:
    """``text`` without characters that would steer the terminal."""
    return "".join(character if character.isprintable() else "�" for character in str(text))
