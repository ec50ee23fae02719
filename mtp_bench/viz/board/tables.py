"""Short tables of a leaderboard, for the terminal and files."""

from collections.abc import Sequence
from dataclasses import replace

from ...core import Column, Table, clean_text, short
from ...judge import LEVELS
from ...scoring import SIGNIFICANT, span_text
from .columns import COLUMN
from .entries import LEVEL_TEXT, Entry, by_board, empty_error, has_map

# headings of columns
_SCORE = "drive\nscore ↑"
_EVENTS = {"ids": "identity\nswitch ↓", "turning": "turning\n↓"}
_DRIVES = {
    "drive_collisions": "at\nfault ↓",
    "drive_near_misses": "near\nmisses ↓",
    "drive_progress": "progress\n↑",
}
_DRIVE_TITLE = "drive score; collisions at fault and near misses per 100 scenes"
_SIGNIFICANT_MARK = "*"  # after a significant difference to STP
_SIGNIFICANT_TEXT = f"{_SIGNIFICANT_MARK} p<{SIGNIFICANT:g}".replace("0.", ".")


def board_tables(entries: Sequence[Entry]) -> list[tuple[Table, list[str]]]:
    """Return a table per environment with the notes below it, partial records last.

    Notes state reasons for missing ranks, training on scored scenes, seals and levels,
    with the names of submissions.
    """
    boards = by_board(entries).values()
    return [(_short_table(board), _notes(board)) for board in boards]


def _short_table(entries: Sequence[Entry]) -> Table:
    env_id = entries[0].env
    is_drive = entries[0].driving is not None
    empty = empty_error(entries)
    title = f"{env_id}: bADE (m)"
    if is_drive:
        title = f"{env_id}: {_DRIVE_TITLE}"
    elif empty is not None:
        title = f"{title}; {empty:.3f} if nothing is predicted"
    columns = [
        Column("agent", key="submission", read=_name),
        Column("ranks", key="rank", read=_ranks),
        Column(_SCORE if is_drive else "bADE\n↓", key="error", read=_score),
        Column("95 %\ninterval", "m", key="interval", read=_interval),
        Column(f"to stp\n{_SIGNIFICANT_TEXT}", "m", key="difference", read=_difference),
    ]
    for key, heading in (_DRIVES if is_drive else _EVENTS).items():
        columns.append(replace(COLUMN[key], heading=heading, group=""))
    return Table(env_id, title, "", entries, columns)


def _name(entry: Entry) -> str:
    marks = ["added" if entry.added else "", entry.part]
    shown = [f"({mark})" for mark in marks if mark]
    return " ".join([_printable(entry.name), *shown])


def _ranks(entry: Entry) -> str | None:
    return span_text(entry.standing.places["all"].span)


def _score(entry: Entry) -> float | None:
    return entry.error if entry.driving is None else entry.driving.drive_score


def _interval(entry: Entry) -> str | None:
    interval = (entry.driving or entry.row).interval
    return interval and "–".join(map(short, interval))


def _difference(entry: Entry) -> str:
    key = "difference" if entry.driving is None else "drive_difference"
    mark = _SIGNIFICANT_MARK if entry.verdict else " "
    return COLUMN[key].shown(entry) + mark


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.place is None:
            reason = f"not ranked ({_printable(entry.why)})"
            names.setdefault(reason, []).append(_printable(entry.name))
    for entry in entries:
        if entry.trained_on_scored:
            reason = _printable(entry.trained_on_scored)
            names.setdefault(reason, []).append(_printable(entry.name))
    notes = [
        f"{text}: {', '.join(dict.fromkeys(agents))}" for text, agents in names.items()
    ]
    if has_map(entries[0].env):
        notes.append("agents see lanes: these ranks compare with no others")
    for level in LEVELS:
        agents = [_printable(entry.name) for entry in entries if entry.level == level]
        suffix = "" if len(agents) == len(entries) else f": {', '.join(agents)}"
        if agents:
            notes.append(f"level {level} ({LEVEL_TEXT[level]}){suffix}")
    if any(entry.converted for entry in entries):
        notes.append("converted from an earlier form of the records, not run again")
    seals = sorted({entry.seal for entry in entries if entry.seal})
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def _printable(text: str) -> str:
    return clean_text(text, len(text) + 1)
