"""Short tables of a leaderboard, for the terminal and files."""

from collections.abc import Sequence
from dataclasses import replace

from ...core import Column, Table, clean_text, short
from ...judge import LEVELS
from ...scoring import SIGNIFICANT, span_text
from .columns import COLUMN
from .entries import LEVEL_TEXT, Entry, by_board, empty_error, has_map

# headings of columns
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
    """Return a table per environment with the notes below it.

    Partial records are last. Notes state reasons for missing ranks, training on scored
    scenes, seals and levels, with the names of submissions.
    """
    boards = by_board(entries).values()
    return [(_short_table(board), _notes(board)) for board in boards]


def _short_table(entries: Sequence[Entry]) -> Table:
    env_id = entries[0].env
    table_title = f"{env_id}: bADE (m)"
    nothing_predicted = empty_error(entries)
    if nothing_predicted is not None:
        table_title = f"{table_title}; {nothing_predicted:.3f} if nothing is predicted"
    score_heading = "bADE\n↓"
    column_headings = _EVENTS
    if entries[0].driving is not None:
        table_title = f"{env_id}: {_DRIVE_TITLE}"
        score_heading = "drive\nscore ↑"
        column_headings = _DRIVES
    columns = [
        Column("agent", key="submission", read=_name),
        Column("ranks", key="rank", read=_ranks),
        Column(score_heading, key="error", read=_score),
        Column("95 %\ninterval", "m", key="interval", read=_interval),
        Column(f"to stp\n{_SIGNIFICANT_TEXT}", "m", key="difference", read=_difference),
    ]
    for key, heading in column_headings.items():
        columns.append(replace(COLUMN[key], heading=heading, group=""))
    return Table(env_id, table_title, "", entries, columns)


def _name(entry: Entry) -> str:
    name = _printable(entry.name)
    if entry.added:
        name = f"{name} (added)"
    return f"{name} ({entry.part})" if entry.part else name


def _ranks(entry: Entry) -> str | None:
    return span_text(entry.standing.places["all"].span)


def _score(entry: Entry) -> float | None:
    if entry.driving is not None:
        return entry.driving.drive_score
    return entry.error


def _interval(entry: Entry) -> str | None:
    interval = (entry.driving or entry.row).interval
    return interval and "–".join(map(short, interval))


def _difference(entry: Entry) -> str:
    column = COLUMN["difference"]
    if entry.driving is not None:
        column = COLUMN["drive_difference"]
    mark = _SIGNIFICANT_MARK if entry.verdict else " "  # one column for either
    return column.shown(entry) + mark


def _notes(entries: Sequence[Entry]) -> list[str]:
    """Return the lines below a table.

    Most name the agents that they are about.
    """
    notes = _reason_notes(entries)
    if has_map(entries[0].env):
        notes.append("agents see lanes: these ranks compare with no others")
    notes += _level_notes(entries)
    if any(entry.converted for entry in entries):
        notes.append("converted from an earlier form of the records, not run again")
    seals = {entry.seal for entry in entries}
    notes += [f"hidden scenes of seal {seal}" for seal in sorted(seals - {""})]
    return notes


def _reason_notes(entries: Sequence[Entry]) -> list[str]:
    """Return reasons for missing ranks, then trainings on scored scenes."""
    reasons = []
    for entry in entries:
        if entry.place is None:
            reasons.append((f"not ranked ({entry.why})", entry.name))
    for entry in entries:
        if entry.trained_on_scored:
            reasons.append((entry.trained_on_scored, entry.name))
    agents: dict[str, list[str]] = {}
    for reason, name in dict.fromkeys(reasons):
        agents.setdefault(_printable(reason), []).append(_printable(name))
    return [f"{reason}: {', '.join(names)}" for reason, names in agents.items()]


def _level_notes(entries: Sequence[Entry]) -> list[str]:
    notes = []
    for level in LEVELS:
        agents = [_printable(entry.name) for entry in entries if entry.level == level]
        note = f"level {level} ({LEVEL_TEXT[level]})"
        if len(agents) == len(entries):
            notes.append(note)
        elif agents:
            notes.append(f"{note}: {', '.join(agents)}")
    return notes


def _printable(text: str) -> str:
    """Replace what a terminal cannot show, and cut nothing off."""
    return clean_text(text, len(text) + 1)
