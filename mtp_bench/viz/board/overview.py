"""The overview of agents by environments."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .answer import short_name
from .entries import Entry, by_board, has_map, simulated


@dataclass(frozen=True)
class Overview:
    """Agents by environments, of one version of the definitions."""

    earlier: str  # that version, where it is not today's
    map: bool  # agents see lanes in all of the environments; else in none
    heads: list[tuple[str, str, bool]]  # id of the table, name, whether it is simulated
    rows: list[tuple[str, list[Entry | None]]]  # name of an agent, its entry per environment

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns, with their number."""
        made = sum(simulated for _, _, simulated in self.heads)
        counts = [("recorded", len(self.heads) - made), ("simulated", made)]
        return [(name, count) for name, count in counts if count]


def overview_of(entries: Sequence[Entry]) -> Overview:
    """The overview of ``entries`` (`entries_of`), the best of the first env first.

    They are of one version of the definitions, and all of environments with a map or all of others.
    """
    boards = by_board(entries)
    agents: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        agents.setdefault(entry.name, {}).setdefault(entry.board, entry)  # of several of one name the first
    seen = {entry.name for entry in entries if entry.saw_truth}
    names = sorted(agents, key=lambda name: (name in seen, [_place(agents[name].get(board)) for board in boards], name))
    rows = [(name, [agents[name].get(board) for board in boards]) for name in names]
    envs = {board: listed[0].env for board, listed in boards.items()}
    heads = [(board, short_name(env), simulated(env)) for board, env in envs.items()]
    first = next(iter(entries), None)
    return Overview(first.record.earlier if first else "", first is not None and has_map(first.env), heads, rows)


def _place(entry: Entry | None) -> tuple[float, ...]:
    """Sort key in one environment: by place, then bADE; partial and missing entries come last."""
    if entry is None or entry.part or entry.error is None:
        return math.inf, True, math.inf
    return entry.place or math.inf, not entry.compared, entry.error
