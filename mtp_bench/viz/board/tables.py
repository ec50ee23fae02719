"""Tables of a leaderboard: short ones for the terminal and files, and those of Markdown pages.

The tables of a page stand between ``<!-- table: NAME -->`` and ``<!-- /table -->``. The names are ``env ID``, a row per
entry of an environment, ``SUBSET of AGENT AGENT ...``, bADE of these agents with a row per environment, and ``costs``,
those of detection and tracking together and of association alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ...errors import MtpBenchError, UnknownNameError
from ...files import clean_text, read_bounded, write_text
from ...records.ranking import conditions, difference_of
from ...scoring.definitions import SIGNIFICANT, SUBSETS, Subset
from ...tables import BLANK, Column, Table, Value, short, to_markdown
from .columns import COLUMN, INTERVALS, PAGE
from .entries import Entry, by_board, empty_error

_SURE = "*"  # after a significant difference to STP
_SIGNIFICANT = f"{_SURE} p<{SIGNIFICANT:g}".replace("0.", ".")
_HEADINGS = {"ids": "ids", "reacquired": "reac-\nquired", "gap": "gap\nclosed", "p95": "p95\nms"}  # by key
MOST_BYTES = 4 << 20  # of a page
_BEGIN, _END = "<!-- table: ", "<!-- /table -->"
_BLOCK = re.compile(rf"^{_BEGIN}(?P<name>[^\n]*) -->\n(?:(?!^{_BEGIN}).)*?^{_END}$", flags=re.DOTALL | re.MULTILINE)


def board_tables(entries: Sequence[Entry]) -> list[tuple[Table, list[str]]]:
    """A table per environment, the best first, with the notes below it.

    A note states a reason for missing ranks, training on scored scenes or a seal, with the names of the submissions.
    """
    return [(_short_table(listed), _notes(listed)) for listed in by_board(entries).values()]


def style_of(entry: Entry) -> str:
    """Rich's style of an entry's row."""
    return "bold green" if entry.added else "" if entry.compared else "dim"


def _short_table(entries: Sequence[Entry]) -> Table:
    empty = empty_error(entries)
    empty_text = "" if empty is None else f"; {empty:.3f} if nothing is predicted"
    title = f"{entries[0].env}{_earlier(entries[0])}: bADE (m){empty_text}"
    numbers = [
        replace(COLUMN[key], heading=f"{text}\n{COLUMN[key].arrow}", group="") for key, text in _HEADINGS.items()
    ]
    columns = [
        Column("submission", key="submission", read=_name),
        Column("ranks", key="rank", read=_span),
        Column("bADE\n↓", key="error", read=lambda entry: entry.error),
        Column("95 %\ninterval", "m", key="interval", read=_interval),
        Column(f"to stp\n{_SIGNIFICANT}", "m", key="difference", read=_difference),
        *numbers,
        Column("verified", key="level", read=lambda entry: entry.level),
    ]
    return Table(entries[0].board, title, "", entries, columns)


def _earlier(entry: Entry) -> str:
    """The definitions of an entry behind a name, where they are earlier ones."""
    return f" (definitions {entry.earlier})" if entry.earlier else ""


def _name(entry: Entry) -> str:
    return _printable(entry.name) + (" (added)" if entry.added else "")


def _span(entry: Entry) -> str | None:
    span = entry.standing.places["all"].span
    return span and "–".join(map(str, dict.fromkeys(span)))


def _interval(entry: Entry) -> str:
    return "–".join(map(short, entry.row.interval)) if entry.row.interval else BLANK


def _difference(entry: Entry) -> str:
    return COLUMN["difference"].shown(entry) + (_SURE if entry.verdict else " ")


def _notes(entries: Sequence[Entry]) -> list[str]:
    names: dict[str, list[str]] = {}
    for entry in entries:
        if entry.place is None:
            names.setdefault(f"not ranked ({_printable(entry.why)})", []).append(_printable(entry.name))
    for entry in entries:
        if entry.trained_on_scored:
            names.setdefault(_printable(entry.trained_on_scored), []).append(_printable(entry.name))
    notes = [f"{text}: {', '.join(dict.fromkeys(listed))}" for text, listed in names.items()]
    seals = sorted({entry.seal for entry in entries if entry.seal})
    return [*notes, *(f"hidden scenes of seal {seal}" for seal in seals)]


def _printable(text: str) -> str:
    return clean_text(text, len(text) + 1)


def fill(page: Path, entries: Sequence[Entry]) -> bool:
    """Write the tables of a page anew from ``entries`` (of `entries_of`); True if they changed.

    Raises MtpBenchError for an unknown or unpaired marker, and if the page cannot be read or written.
    """
    text = read_bounded(page, MOST_BYTES, MtpBenchError)
    new = filled(text, entries, str(page))
    if new != text:
        write_text(page, new)
    return new != text


def filled(text: str, entries: Sequence[Entry], where: str) -> str:
    """``text`` with its tables made anew; ``where``: name of the page, for errors."""
    count = sum(1 for _ in _BLOCK.finditer(text))
    begun, ended = (sum(line.startswith(mark) for line in text.splitlines()) for mark in (_BEGIN, _END))
    if not count == begun == ended:
        raise MtpBenchError(
            f"{where}: {begun} lines `{_BEGIN}NAME -->` and {ended} lines `{_END}`, expected them in pairs"
        )
    if not count:
        raise MtpBenchError(f"{where}: no table to fill in; mark one by lines `{_BEGIN}NAME -->` and `{_END}`")

    def block(match: re.Match[str]) -> str:
        table = _table(match["name"], entries, where)
        return f"{_BEGIN}{match['name']} -->\n\n{to_markdown(table)}\n{_END}"

    return _BLOCK.sub(block, text)


def _table(name: str, entries: Sequence[Entry], where: str) -> Table:
    first, *further = name.split()
    if first == "env" and len(further) == 1:
        return env_table(further[0], entries)
    if name == "costs":
        return costs_table(entries)
    if first in SUBSETS and further[:1] == ["of"] and further[1:]:
        return across_table(next(subset for subset in SUBSETS if subset == first), further[1:], entries)
    raise MtpBenchError(f"{where}: table {name!r}, expected `env ID`, `SUBSET of AGENT AGENT ...` or `costs`")


def env_table(env_id: str, entries: Sequence[Entry]) -> Table:
    """A row per entry of an environment; those of earlier definitions if there are no others."""
    listed = next((each for each in by_board(entries).values() if each[0].env == env_id), None)
    if listed is None:
        raise UnknownNameError("environment", env_id, sorted({entry.env for entry in entries}))
    names = [
        Column(f"agent{_earlier(listed[0])}", key="agent", read=lambda entry: f"`{entry.name}`"),
        Column("rank", key="rank", read=lambda entry: entry.rank),
    ]
    keys = [key for page_key in PAGE for key in (page_key, INTERVALS.get(page_key, "")) if key]
    return Table(env_id, env_id, "", listed, [*names, *(replace(COLUMN[key], optional=True) for key in keys)])


def across_table(subset: Subset, agents: Sequence[str], entries: Sequence[Entry]) -> Table:
    """Values of bADE of agents on one subset: a row per environment in which all of them have a record."""
    names = sorted({entry.name for entry in entries})
    for agent in agents:
        if agent not in names:
            raise UnknownNameError("agent", agent, names)
    rows = _by_name(agents, entries)
    columns = [Column("environment", key="env", read=lambda row: row[agents[0]].env + _earlier(row[agents[0]]))]
    for agent in agents:
        columns.append(Column(f"`{agent}`", "m", "lower", key=agent, read=_value(subset, agent, "error")))
        columns.append(Column(interval=True, key=f"{agent}_interval", read=_value(subset, agent, "interval")))
    for what in ("objects", "units"):
        read = _value(subset, agents[0], f"effective_{what}")
        columns.append(Column(f"effective {what}", format=".1f", key=what, read=read))
    return Table(subset, f"bADE on {subset}", "", rows, columns)


def costs_table(entries: Sequence[Entry]) -> Table:
    """Costs of detection and tracking together, and of association alone: a row per environment and ranked subset."""
    both, alone = ("stp", "truth_past"), ("stp_same_budget", "perfect_association_same_samples")
    subsets: tuple[Subset, ...] = ("all", "ids", "reacquired")
    rows = [(subset, known) for known in _by_name((*both, *alone), entries) for subset in subsets]
    columns = [
        Column("environment", key="env", read=lambda row: row[1]["stp"].env + _earlier(row[1]["stp"])),
        Column("subset", key="subset", read=lambda row: row[0]),
    ]
    for heading, (worse, better) in (("detection and tracking together", both), ("of which association", alone)):
        columns += [
            Column(heading, "m", key=better, format="+.3f", read=_cost(worse, better, "mean")),
            Column(interval=True, key=f"{better}_interval", read=_cost(worse, better, "interval")),
            Column("p", key=f"{better}_p", format=".3f", read=_cost(worse, better, "p")),
        ]
    return Table("costs", "Costs of detection and tracking", "", rows, columns)


def _cost(worse: str, better: str, what: str) -> Callable[[tuple[Subset, dict[str, Entry]]], Value]:
    """A field of the difference between two agents; None where there is no target, or the data differ."""

    def read(row: tuple[Subset, dict[str, Entry]]) -> Value:
        one, other = row[1][worse], row[1][better]
        alike = conditions(one.sums) == conditions(other.sums)
        return getattr(difference_of(one, other, row[0]) if alike else None, what, None)

    return read


def _by_name(agents: Sequence[str], entries: Sequence[Entry]) -> list[dict[str, Entry]]:
    """Entries by name, for each environment in which all of the agents have one; earlier ones without others."""
    rows: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        known = {entry.name: entry for entry in reversed(listed)}
        if all(agent in known for agent in agents):
            rows.setdefault(listed[0].env, known)
    return list(rows.values())


def _value(subset: Subset, agent: str, name: str) -> Callable[[dict[str, Entry]], Value]:
    return lambda row: getattr(row[agent].row_of(subset), name)
