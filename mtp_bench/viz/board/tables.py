"""Short tables of a leaderboard, for the terminal and files."""

from collections.abc import Sequence
from dataclasses import replace

from ...core import Column, Table, clean_text, short
from ...judge import LEVELS
from ...scoring import SIGNIFICANT, span_text
from .columns import COLUMN
from .entries import LEVEL_TEXT, Entry, by_board, empty_error, has_map

_SCORE = "drive\nscore ↑"
_EVENTS = {
    "ids": "identity\nswitch ↓",
    "turning": "turning\n↓",
}  # headings of the last columns
_DRIVES = {
    "drive_collisions": "at\nfault ↓",
    "drive_near_misses": "near\nmisses ↓",
    "drive_progress": "progress\n↑",
}
_DRIVEN = "drive score; collisions at fault and near misses per 100 scenes"
_SURE = "*"  # after a significant difference to STP
_SIGNIFICANT = f"{_SURE} p<{SIGNIFICANT:g}".replace("0.", ".")


def board_tables(entries: Sequence[Entry]) -> list[tuple[Table, list[str]]]:
    """A table per environment, the best first and partial records last, with the notes below it.

    Notes state reasons for missing ranks, training on scored scenes, seals and levels, with the names of submissions.
    """
    return [
        (_short_table(listed), _notes(listed)) for listed in by_board(entries).values()
    ]


def _short_table(entries: Sequence[Entry]) -> Table:
    empty = empty_error(entries)
    empty_text = "" if empty is None else f"; {empty:.3f} if nothing is predicted"
    drives = entries[0].driving is not None
    title = f"{entries[0].env}: {_DRIVEN if drives else f'bADE (m){empty_text}'}"
    columns = [
        Column("agent", key="submission", read=_name),
        Column(
            "ranks",
            key="rank",
            read=lambda entry: span_text(entry.standing.places["all"].span),
        ),
        Column(
            _SCORE if drives else "bADE\n↓",
            key="error",
            read=lambda e: getattr(e.driving, "drive_score", e.error),
        ),
        Column("95 %\ninterval", "m", key="interval", read=_interval),
        Column(f"to stp\n{_SIGNIFICANT}", "m", key="difference", read=_difference),
        *(
            replace(COLUMN[key], heading=text, group="")
            for key, text in (_DRIVES if drives else _EVENTS).items()
        ),
    ]
    return Table(entries[0].env, title, "", entries, columns)


def _name(entry: Entry) -> str:
    marks = [mark for mark in ("added" * entry.added, entry.part) if mark]
    return " ".join([_printable(entry.name), *(f"({mark})" for mark in marks)])


def _interval(entry: Entry) -> str | None:
    interval = (entry.driving or entry.row).interval
    return interval and "–".join(map(short, interval))


def _difference(entry: Entry) -> str:
    column = COLUMN["difference" if entry.driving is None else "drive_difference"]
    return column.shown(entry) + (_SURE if entry.verdict else " ")


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.place is None:
            names.setdefault(f"not ranked ({_printable(entry.why)})", []).append(
                _printable(entry.name)
            )
    for entry in entries:
        if entry.trained_on_scored:
            names.setdefault(_printable(entry.trained_on_scored), []).append(
                _printable(entry.name)
            )
    notes = [
        f"{text}: {', '.join(dict.fromkeys(listed))}" for text, listed in names.items()
    ]
    notes += (
        ["agents see lanes: these ranks compare with no others"]
        if has_map(entries[0].env)
        else []
    )
    seals = sorted({entry.seal for entry in entries if entry.seal})
    for level in LEVELS:
        listed = [_printable(entry.name) for entry in entries if entry.level == level]
        named = "" if len(listed) == len(entries) else f": {', '.join(listed)}"
        notes += [f"level {level} ({LEVEL_TEXT[level]}){named}"] if listed else []
    if any(entry.converted for entry in entries):
        notes.append("converted from an earlier form of the records, not run again")
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def _printable(text: str) -> str:
    return clean_text(text, len(text) + 1)
