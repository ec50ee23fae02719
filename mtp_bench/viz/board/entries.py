"""Entries of a leaderboard: records with their places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]

SUBSETS = ("ids", "lost", "reacquired", "frag")
LEVELS = ("scored", "re-scored", "re-run", "hidden seeds")  # of verification, each includes the ones before it
LEVEL_TEXT = {
    "scored": "scored by its authors",
    "re-scored": "scored again from its stored rollouts",
    "re-run": "run again from its submission",
    "hidden seeds": "run again on scenes that were not public",
}


@dataclass(frozen=True, eq=False)
class Entry:
    """One line of a leaderboard."""

    record: Row  # the fields of a record, as JSON
    rank: int | None  # None: shown, not ranked
    why: str  # the reason for that; "" where it is ranked
    link: str | None  # relative address of the record's file
    added: bool  # not part of the leaderboard: where it would stand

    @property
    def env(self) -> str:
        """Id of the environment."""
        return str(self.record["env"]["id"])

    @property
    def name(self) -> str:
        """Name of the submission."""
        return str(self.record["submission"]["name"])

    def row(self, subset: str = "all") -> Row:
        """The row of one subset, with the keys of `compare --json`; empty where nothing was scored."""
        return next((row for row in self.record.get("rows") or () if row["subset"] == subset), {})

    def number(self, key: str, subset: str = "all") -> float | None:
        """A finite number of a row, else None."""
        return finite(self.row(subset).get(key))

    @property
    def error(self) -> float | None:
        """What ranks: the missing-aware error over all targets, metres."""
        return self.number("missing_aware")

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of the error, metres."""
        return interval_of(self.row())


def finite(value: Any) -> float | None:
    """A number that can be drawn and sorted; None for everything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def interval_of(row: Row) -> tuple[float, float] | None:
    """The two ends of a row's interval, where both are numbers."""
    low, high = (*(finite(end) for end in row.get("interval") or ()), None, None)[:2]
    return None if low is None or high is None else (low, high)


def condition_of(entry: Entry) -> tuple[str, ...]:
    """What entries share that are ranked against each other; the newer definitions first, where sizes are equal."""
    env = entry.record["env"]
    definitions = str(entry.record["scorer"]["definitions"])
    return definitions, *(str(env.get(name)) for name in ("card_digest", "split", "data_manifest"))


def silence_of(entries: Sequence[Entry]) -> float | None:
    """What an agent that says nothing scores in the ranking of one environment, metres; None where it is not known."""
    ranked = next((entry for entry in entries if entry.rank is not None), None)
    return None if ranked is None else finite((ranked.record.get("details") or {}).get("silence"))


def by_env(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The entries of each environment, in their order."""
    boards: dict[str, list[Entry]] = {}
    for entry in entries:
        boards.setdefault(entry.env, []).append(entry)
    return boards
