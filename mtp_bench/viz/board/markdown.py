"""Tables of the leaderboard in Markdown pages, between markers: ``<!-- table: NAME -->`` and ``<!-- /table -->``.

The names are ``env ID``, a row per entry of an environment, and ``SUBSET of AGENT AGENT ...``, bADE of these agents on
one subset with a row per environment.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ...errors import MtpBenchError, UnknownNameError
from ...files import read_bounded, write_text
from ...scoring.subsets import SUBSETS, Subset
from ...tables import Column, Table, Value, to_markdown
from .columns import COLUMN, INTERVALS, PAGE
from .entries import Entry, by_board

MOST_BYTES = 4 << 20  # of a page
_BEGIN, _END = "<!-- table: ", "<!-- /table -->"
_BLOCK = re.compile(rf"^{_BEGIN}(?P<name>[^\n]*) -->\n(?:(?!^{_BEGIN}).)*?^{_END}$", flags=re.DOTALL | re.MULTILINE)


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
    if first in SUBSETS and further[:1] == ["of"] and further[1:]:
        return across_table(next(subset for subset in SUBSETS if subset == first), further[1:], entries)
    raise MtpBenchError(f"{where}: table {name!r}, expected `env ID` or `SUBSET of AGENT AGENT ...`")


def env_table(env_id: str, entries: Sequence[Entry]) -> Table:
    """A row per entry of an environment; entries of an earlier version if the current one has none."""
    listed = next((each for each in by_board(entries).values() if each[0].env == env_id), None)
    if listed is None:
        raise UnknownNameError("environment", env_id, sorted({entry.env for entry in entries}))
    names = [
        Column("agent", key="agent", read=lambda entry: f"`{entry.name}`"),
        Column("rank", key="rank", read=lambda entry: entry.rank),
    ]
    keys = [key for page_key in PAGE for key in (page_key, INTERVALS.get(page_key, "")) if key]
    return Table(env_id, env_id, "", listed, [*names, *(replace(COLUMN[key], optional=True) for key in keys)])


def across_table(subset: Subset, agents: Sequence[str], entries: Sequence[Entry]) -> Table:
    """The error of agents on one subset: a row per environment in which all of them have a record."""
    names = sorted({entry.name for entry in entries})
    for agent in agents:
        if agent not in names:
            raise UnknownNameError("agent", agent, names)
    rows: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        known = {entry.name: entry for entry in reversed(listed)}
        if all(agent in known for agent in agents):
            rows.setdefault(listed[0].env, known)
    columns = [Column("environment", key="env", read=lambda row: row[agents[0]].env)]
    for agent in agents:
        columns.append(Column(f"`{agent}`", "m", "lower", key=agent, read=_value(subset, agent, "error")))
        columns.append(Column(interval=True, key=f"{agent}_interval", read=_value(subset, agent, "interval")))
    for what in ("objects", "units"):
        read = _value(subset, agents[0], f"effective_{what}")
        columns.append(Column(f"effective {what}", format=".1f", key=what, read=read))
    return Table(subset, f"bADE on {subset}", "", list(rows.values()), columns)


def _value(subset: Subset, agent: str, name: str) -> Callable[[dict[str, Entry]], Value]:
    return lambda row: getattr(row[agent].row_of(subset), name)
