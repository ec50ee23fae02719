"""Entries of a leaderboard: records with their places, and the order in which they stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...records.attestation import Level
from ...records.ranking import Standing, standings
from ...records.record import Record
from ...scoring.subsets import Subset

LEVEL_TEXT: dict[Level, str] = {
    "scored": "scored by its authors",
    "re-scored": "scored again from its stored rollouts",
    "re-run": "run again from its submission",
    "hidden": "run again, and on scenes that were not public",
}


@dataclass(frozen=True, eq=False)
class Entry:
    """One line of a leaderboard."""

    record: Record
    standing: Standing
    link: str | None = None  # relative address of the record's file
    added: bool = False  # not part of the leaderboard: where it would stand
    level: Level = "scored"  # how far it was checked

    @property
    def env(self) -> str:
        """Id of the environment."""
        return self.record.env.id

    @property
    def name(self) -> str:
        """Name of the submission."""
        return self.record.submission.name

    @property
    def rank(self) -> int | None:
        """Its rank over all targets; None: shown, not ranked."""
        return self.standing.places["all"].rank

    @property
    def why(self) -> str:
        """Why it has none; empty where it has one."""
        return self.standing.places["all"].why

    @property
    def compared(self) -> bool:
        """Whether it stands in the main ranking of its environment, even where that has too few recordings to rank."""
        return self.standing.compared

    @property
    def error(self) -> float | None:
        """What ranks over all targets, metres."""
        return self.record.row.error

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of the error, metres."""
        return self.record.row.interval

    def same_predictor_gap(self, subset: Subset) -> float | None:
        """What it closes of the gap between ends with its own predictor, where that is known."""
        if self.record.submission.ends == "controls":
            return self.standing.gaps.get(subset)
        return self.record.row_of(subset).gap_closed_same_predictor


def entries_of(found: Sequence[tuple[Record, str | None, bool]]) -> list[Entry]:
    """The entries in the order of the leaderboard: by environment, rank, error and name.

    ``found``: records, each with its link and whether it is added.
    """
    places = standings([record for record, _, _ in found])
    return sorted((Entry(record, places[record.digest], link, added) for record, link, added in found), key=_order)


def silence_of(entries: Sequence[Entry]) -> float | None:
    """What an agent that says nothing scores in one environment, metres; None where it is not known."""
    return next((entry.record.silence for entry in entries if entry.compared), None)


def by_env(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The entries of each environment, in their order."""
    boards: dict[str, list[Entry]] = {}
    for entry in entries:
        boards.setdefault(entry.env, []).append(entry)
    return boards


def _order(entry: Entry) -> tuple[str, float, bool, float, str, str]:
    rank = math.inf if entry.rank is None else entry.rank
    error = math.inf if entry.error is None else entry.error
    return entry.env, rank, not entry.compared, error, entry.name, entry.record.digest
