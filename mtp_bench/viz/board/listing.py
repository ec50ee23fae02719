"""The leaderboard as a short table per environment, for the terminal, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...scoring.definitions import SIGNIFICANT
from ...tables import BLANK, Column, Table, short
from .columns import COLUMN
from .entries import Entry, by_board, empty_error

_SURE = "*"  # after a significant difference to STP
_SIGNIFICANT = f"{_SURE} p<{SIGNIFICANT:g}".replace("0.", ".")
_HEADINGS = {"ids": "ids", "reacquired": "reac-\nquired", "gap": "gap\nclosed", "p95": "p95\nms"}  # by key


def board_tables(entries: Sequence[Entry]) -> list[tuple[Table, list[str]]]:
    """A table per environment, the best first, with the notes below it.

    A note states a reason for missing ranks, training on scored scenes or a seal, with the names of the submissions.
    """
    return [(_table(listed), _notes(listed)) for listed in by_board(entries).values()]


def style_of(entry: Entry) -> str:
    """Rich's style of an entry's row."""
    return "bold green" if entry.added else "" if entry.compared else "dim"


def _table(entries: Sequence[Entry]) -> Table:
    empty = empty_error(entries)
    empty_text = "" if empty is None else f"; {empty:.3f} if nothing is predicted"
    version = f" (version {entries[0].version})" if entries[0].version else ""
    title = f"{entries[0].env}{version}: bADE (m){empty_text}"
    numbers = [
        replace(COLUMN[key], heading=f"{text}\n{COLUMN[key].arrow}", group="") for key, text in _HEADINGS.items()
    ]
    columns = [
        Column("submission", key="submission", read=_name),
        Column("rank", key="rank", read=lambda entry: entry.rank),
        Column("bADE\n↓", key="error", read=lambda entry: entry.error),
        Column("95 %\ninterval", "m", key="interval", read=_interval),
        Column(f"to stp\n{_SIGNIFICANT}", "m", key="difference", read=_difference),
        *numbers,
        Column("verified", key="level", read=lambda entry: entry.level),
    ]
    return Table(entries[0].board, title, "", entries, columns)


def _name(entry: Entry) -> str:
    return printable(entry.name) + (" (added)" if entry.added else "")


def _interval(entry: Entry) -> str:
    return "–".join(map(short, entry.row.interval)) if entry.row.interval else BLANK


def _difference(entry: Entry) -> str:
    return COLUMN["difference"].shown(entry) + (_SURE if entry.verdict else " ")


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.rank is None:
            names.setdefault(f"not ranked ({printable(entry.why)})", []).append(printable(entry.name))
    for entry in entries:
        if entry.trained_on_scored:
            names.setdefault(printable(entry.trained_on_scored), []).append(printable(entry.name))
    notes = [f"{text}: {', '.join(dict.fromkeys(listed))}" for text, listed in names.items()]
    seals = sorted({entry.seal for entry in entries if entry.seal})
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def printable(text: str) -> str:
    """``text`` with a replacement for each unprintable character, so that it cannot control the terminal."""
    return "".join(character if character.isprintable() else "�" for character in text)
