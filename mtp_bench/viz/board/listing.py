"""The leaderboard as a short table per environment for the terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..terminal.output import NOTHING, short, slim_table
from .columns import COLUMNS, shown
from .entries import Entry, by_env, silence_of

if TYPE_CHECKING:
    from rich.table import Table

_SHOWN = {"ids": "ids", "reacquired": "reac-\nquired", "gap": "gap\nclosed", "p95": "p95\nms"}  # key -> heading


def board_tables(entries: Sequence[Entry]) -> list[Table]:
    """A table per environment, the best first."""
    return [_table(env_id, listed) for env_id, listed in by_env(entries).items()]


def board_notes(entries: Sequence[Entry]) -> list[list[str]]:
    """Per environment a sentence for each reason for which some are not ranked, with their names, and for each seal."""
    return [_notes(listed) for listed in by_env(entries).values()]


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.rank is None:
            names.setdefault(printable(entry.why), []).append(printable(entry.name))
    notes = [f"not ranked ({reason}): {', '.join(dict.fromkeys(listed))}" for reason, listed in names.items()]
    seals = sorted({entry.seal for entry in entries if entry.seal})
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def _table(env_id: str, entries: Sequence[Entry]) -> Table:
    from rich.markup import escape

    columns = [column for column in COLUMNS if column.key in _SHOWN]
    silence = silence_of(entries)
    said = "" if silence is None else f"; saying nothing scores {silence:.3f}"
    numbers = (f"{_SHOWN[column.key]}\n{column.arrow}" for column in columns)
    headings = ("submission", "rank", "error\n↓", "95 % interval", *numbers, "verified")
    table = slim_table(f"{env_id}: error (m) at the budgets{said}", headings, left=("verified",))
    for entry in entries:
        bounds = entry.interval
        style = "bold green" if entry.added else "" if entry.compared else "dim"
        table.add_row(
            escape(printable(entry.name)) + (" (added)" if entry.added else ""),
            NOTHING if entry.rank is None else str(entry.rank),
            short(entry.error),
            NOTHING if bounds is None else f"\\[{short(bounds[0])}, {short(bounds[1])}]",
            *(shown(column, entry) for column in columns),
            entry.level,
            style=style,
        )
    return table


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Any]]]:
    """What the tables show: a list of rows per environment, None where nothing is known."""
    return {env_id: [_row(entry) for entry in listed] for env_id, listed in by_env(entries).items()}


def _row(entry: Entry) -> dict[str, Any]:
    kept = ("division", "status", "digest")
    return {
        "rank": entry.rank,
        "submission": entry.name,
        "not_ranked_because": entry.why or None,
        "added": entry.added,
        "interval": list(entry.interval) if entry.interval else None,
        **{column.key: column.value(entry) for column in COLUMNS},
        **{name: getattr(entry.record, name) for name in kept},
        "level": entry.level,
        "checked": entry.checked or None,
        "made": entry.record.measured.made,
    }


def printable(text: str) -> str:
    """``text`` without characters that would steer the terminal."""
    return "".join(character if character.isprintable() else "�" for character in text)
