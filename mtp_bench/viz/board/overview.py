"""The overview of agents by environments, and the leader of the first one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...records.held_back import difference_of
from ...scoring.statistics import PairedDifference
from .entries import Entry, by_board, simulated

_NAMED = 3  # leaders


@dataclass(frozen=True)
class Overview:
    """Agents by environments, of one version of the definitions."""

    earlier: str  # that version, where it is not today's
    heads: list[tuple[str, str, bool]]  # id of the table, name, whether it is simulated
    rows: list[tuple[str, list[Entry | None]]]  # name of an agent, its entry per environment

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns, with their number."""
        made = sum(simulated for _, _, simulated in self.heads)
        counts = [("recorded", len(self.heads) - made), ("simulated", made)]
        return [(name, count) for name, count in counts if count]


def overview_of(entries: Sequence[Entry]) -> Overview:
    """The overview of ``entries`` (`entries_of`) of one version of the definitions, the best of the first env first."""
    boards = by_board(entries)
    agents: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        agents.setdefault(entry.name, {}).setdefault(entry.board, entry)  # of several of one name the first
    names = sorted(agents, key=lambda name: (*(_place(agents[name].get(board)) for board in boards), name))
    rows = [(name, [agents[name].get(board) for board in boards]) for name in names]
    envs = {board: listed[0].env for board, listed in boards.items()}
    heads = [(board, short_name(env), simulated(env)) for board, env in envs.items()]
    return Overview(entries[0].earlier if entries else "", heads, rows)


def _place(entry: Entry | None) -> tuple[float, float]:
    """Place and error in one environment; a missing entry comes last."""
    if entry is None:
        return math.inf, math.inf
    return (
        math.inf if entry.place is None else entry.place,
        math.inf if entry.error is None or not entry.compared else entry.error,
    )


def leader_of(entries: Sequence[Entry], ids: Mapping[Entry, str]) -> dict[str, Any] | None:
    """Content of the head of the page: the leader of the first table; None where that has no ranks."""
    ranked = [entry for entry in next(iter(by_board(entries).values()), []) if entry.place is not None]
    best = [entry for entry in ranked if entry.among_best]
    if not best:
        return None
    leader, row = best[0], best[0].row
    following = ranked[len(best)] if len(ranked) > len(best) else None
    return {
        "board": leader.board,
        "name": short_name(leader.env),
        "earlier": leader.earlier,
        "first": [(entry, ids[entry]) for entry in best[:_NAMED]],
        "more": len(best[_NAMED:]),
        "error": f"{leader.error:.3f}",
        "less_stp": _lead(leader.difference()),
        "next": None if following is None else (following, ids[following]),
        "less_next": None if following is None else _lead(difference_of(leader, following, "all")),
        "ranked": len(ranked),
        "targets": f"{row.targets:,}".replace(",", " "),
        "scenes": row.scenes,
    }


def short_name(env_id: str) -> str:
    """Short form of an id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")


def _lead(difference: PairedDifference | None) -> dict[str, str] | None:
    """Size and direction of a difference in words, with its interval and p; None without an interval."""
    if difference is None or difference.interval is None:
        return None
    sign = -1 if difference.mean < 0 else 1
    low, high = sorted(sign * end for end in difference.interval)
    return {
        "by": f"{abs(difference.mean):.3f} m {'lower' if difference.mean < 0 else 'higher'}",
        "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
        "p": f"p {p_value(difference.p)}",
    }


def p_value(p: float) -> str:
    """A p-value as text: "= .034", or "< .001" for a smaller one."""
    return "< .001" if p < 0.001 else f"= {p:.3f}".replace("0.", ".", 1)
