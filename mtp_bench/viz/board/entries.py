"""Entries of a leaderboard: records with their places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ...records.record import Level, Record
from ...scoring.rows import Row
from ...scoring.subsets import Subset

LEVEL_TEXT: dict[Level, str] = {
    "scored": "scored by its authors",
    "re-scored": "scored again from its stored rollouts",
    "re-run": "run again from its submission",
    "hidden seeds": "run again on scenes that were not public",
}


@dataclass(frozen=True, eq=False)
class Entry:
    """One line of a leaderboard."""

    record: Record
    rank: int | None  # None: shown, not ranked
    why: str = ""  # the reason for that; "" where it is ranked
    link: str | None = None  # relative address of the record's file
    added: bool = False  # not part of the leaderboard: where it would stand
    gaps: Mapping[Subset, float] = field(default_factory=dict)  # what it closes of the gap, where that is known

    @property
    def env(self) -> str:
        """Id of the environment."""
        return self.record.env.id

    @property
    def name(self) -> str:
        """Name of the submission."""
        return self.record.submission.name

    def row(self, subset: Subset = "all") -> Row:
        """The row of one subset."""
        return next(row for row in self.record.rows if row.subset == subset)

    @property
    def error(self) -> float | None:
        """What ranks: the missing-aware error over all targets, metres."""
        return self.row().missing_aware

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of the error, metres."""
        return self.row().interval


def silence_of(entries: Sequence[Entry]) -> float | None:
    """What an agent that says nothing scores in the ranking of one environment, metres; None where it is not known."""
    return next((entry.record.silence for entry in entries if entry.rank is not None), None)


def by_env(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The entries of each environment, in their order."""
    boards: dict[str, list[Entry]] = {}
    for entry in entries:
        boards.setdefault(entry.env, []).append(entry)
    return boards
