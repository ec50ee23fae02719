"""The leaderboard as a short table per environment for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...scoring.definitions import SIGNIFICANT
from ..terminal.output import NOTHING, short, slim_table
from .columns import COLUMN, COLUMNS, shown
from .entries import Entry, by_env, silence_of

if TYPE_CHECKING:
    from rich.table import Table

_SHOWN = {"ids": "ids", "reacquired": "reac-\nquired", "gap": "gap\nclosed", "p95": "p95\nms"}  # key -> heading
_SURE = "*"  # after a difference to STP that is significant
_SIGNIFICANT = f"{_SURE} p<{SIGNIFICANT:g}".replace("0.", ".")


def board_tables(entries: Sequence[Entry]) -> list[tuple[Table, list[str]]]:
    """A table per environment, the best first, and what is said below it.

    That is a sentence for each reason for which some are not ranked and for what was trained on scored scenes, with
    their names, and for each seal.
    """
    return [(_table(env_id, listed), _notes(listed)) for env_id, listed in by_env(entries).items()]


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.rank is None:
            names.setdefault(f"not ranked ({printable(entry.why)})", []).append(printable(entry.name))
    for entry in entries:
        if entry.trained_on_scored:
            names.setdefault(printable(entry.trained_on_scored), []).append(printable(entry.name))
    notes = [f"{said}: {', '.join(dict.fromkeys(listed))}" for said, listed in names.items()]
    seals = sorted({entry.seal for entry in entries if entry.seal})
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def _table(env_id: str, entries: Sequence[Entry]) -> Table:
    from rich.markup import escape

    columns = [column for column in COLUMNS if column.key in _SHOWN]
    silence = silence_of(entries)
    said = "" if silence is None else f"; saying nothing scores {silence:.3f}"
    numbers = (f"{_SHOWN[column.key]}\n{column.arrow}" for column in columns)
    to_stp = f"to stp\n{_SIGNIFICANT}"
    headings = ("submission", "rank", "error\n↓", "95 %\ninterval", to_stp, *numbers, "verified")
    table = slim_table(f"{env_id}: error (m) at the budgets{said}", headings, left=("verified",))
    for entry in entries:
        bounds = entry.row.interval
        style = "bold green" if entry.added else "" if entry.compared else "dim"
        table.add_row(
            escape(printable(entry.name)) + (" (added)" if entry.added else ""),
            NOTHING if entry.rank is None else str(entry.rank),
            short(entry.error),
            NOTHING if bounds is None else f"{short(bounds[0])}–{short(bounds[1])}",
            shown(COLUMN["difference"], entry) + (_SURE if entry.verdict else " "),
            *(shown(column, entry) for column in columns),
            entry.level,
            style=style,
        )
    return table


def printable(text: str) -> str:
    """``text`` without characters that would steer the terminal."""
    return "".join(character if character.isprintable() else "�" for character in text)
