"""The overview: agents by environments, with rank and error in each cell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .entries import Entry, by_env
from .order import short_name, simulated


@dataclass(frozen=True)
class Head:
    """A column of the overview."""

    env: str
    name: str
    simulated: bool


@dataclass(frozen=True)
class Overview:
    """Agents by environments."""

    heads: list[Head]
    rows: list[tuple[str, list[Entry | None]]]  # name of an agent, its entry per environment

    @property
    def marked(self) -> bool:
        """Whether something in an agent was trained on scenes that are scored."""
        return any(entry is not None and entry.trained_on_scored for _, row in self.rows for entry in row)

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns, with their number."""
        made = sum(head.simulated for head in self.heads)
        found = [("recorded", len(self.heads) - made), ("simulated", made)]
        return [(name, count) for name, count in found if count]


def overview_of(entries: Sequence[Entry]) -> Overview:
    """The overview of ``entries`` (from `entries_of`), the best of the first environment first."""
    boards = by_env(entries)
    found: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        found.setdefault(entry.name, {}).setdefault(entry.env, entry)  # of several of one name the first
    names = sorted(found, key=lambda name: (*_places(found[name], boards), name))
    rows = [(name, [found[name].get(env) for env in boards]) for name in names]
    return Overview([Head(env, short_name(env), simulated(env)) for env in boards], rows)


def _places(mine: Mapping[str, Entry], boards: Mapping[str, Sequence[Entry]]) -> tuple[tuple[float, float], ...]:
    """Rank and error in each environment; what has none comes last."""
    return tuple(_place(mine.get(env)) for env in boards)


def _place(entry: Entry | None) -> tuple[float, float]:
    if entry is None:
        return math.inf, math.inf
    return (
        math.inf if entry.rank is None else entry.rank,
        math.inf if entry.error is None or not entry.compared else entry.error,
    )
