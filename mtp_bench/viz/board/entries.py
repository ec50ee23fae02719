"""Entries of a leaderboard: records with their places, and the order in which they stand."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ...records.ranking import STP, conditions, record_gap
from ...records.record import Level, Record
from ...scoring.rows import Row
from ...scoring.subsets import SUBSETS, Subset

TRUTH = "truth_past"
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


def standings(entries: Sequence[Entry]) -> list[Entry]:
    """The entries in the order of the leaderboard: by environment, rank, error and name, with the gaps they close.

    What cannot be compared with most of its environment loses its rank, and so does the open division beside a closed
    one.
    """
    listed = [entry for of_env in by_env(entries).values() for entry in _with_gaps(_one_ranking(of_env))]
    return sorted(listed, key=_order)


def _one_ranking(entries: Sequence[Entry]) -> list[Entry]:
    """The entries of one environment with the ranks of its main ranking alone."""
    ranked = [entry for entry in entries if entry.rank is not None and entry.record.division == "closed"]
    sizes = Counter(conditions(entry.record) for entry in ranked)
    main = max(sizes, key=lambda condition: (sizes[condition], condition), default=None)
    return [entry if entry in ranked and conditions(entry.record) == main else _outside(entry) for entry in entries]


def _outside(entry: Entry) -> Entry:
    """An entry that was ranked among others than those of the main ranking, if it was."""
    if entry.rank is None:
        return entry
    if entry.record.division == "open":
        return replace(entry, rank=None, why=f"open division: rank {entry.rank} there")
    return replace(entry, rank=None, why="other data, split, card or definitions than the ranked ones")


def _with_gaps(entries: Sequence[Entry]) -> Sequence[Entry]:
    """The entries of one environment with what they close of the gap between STP and the one that saw the truth.

    A record alone cannot tell; without both of these nothing is known.
    """
    stp = next((entry.record for entry in entries if entry.name == STP and entry.rank is not None), None)
    finished = (entry.record for entry in entries if entry.record.status == "finished")
    truth = next((record for record in finished if record.submission.name == TRUTH), None)
    if stp is None or truth is None or conditions(stp) != conditions(truth):
        return entries
    return [replace(entry, gaps=_gaps(entry.record, stp, truth)) for entry in entries]


def _gaps(record: Record, stp: Record, truth: Record) -> dict[Subset, float]:
    same = conditions(record) == conditions(stp) and record.samples == stp.samples
    if not same or record.status != "finished":
        return {}
    closed: dict[Subset, float] = {}
    for subset in SUBSETS:
        gap = record_gap(record, stp, truth, subset)
        if gap is not None:
            closed[subset] = gap.closed
    return closed


def _order(entry: Entry) -> tuple[str, float, float, str, str]:
    rank = math.inf if entry.rank is None else entry.rank
    error = math.inf if entry.error is None else entry.error
    return entry.env, rank, error, entry.name, entry.record.digest
