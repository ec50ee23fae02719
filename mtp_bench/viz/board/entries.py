"""Records of results as entries of a leaderboard: where each stands, and why some stand nowhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...errors import MtpBenchError

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


def entries_of(
    records: Sequence[Row],
    ranks: Sequence[int | None],
    reasons: Sequence[str] | None = None,
    links: Sequence[str | None] | None = None,
    added: Collection[int] = (),
) -> list[Entry]:
    """Entries in the order of the leaderboard: by environment, rank, error and name.

    ``records`` hold the fields of a record as JSON. ``ranks`` go with them (None: shown, not ranked), as do ``reasons``
    (why there is no rank) and ``links`` (addresses of the files, relative to the page); ``added`` holds the places of
    records that are not part of the leaderboard. What cannot be compared with most of its environment loses its
    rank, and so does the open division beside a closed one. Raises MtpBenchError where the lengths differ.
    """
    reasons = reasons if reasons is not None else [""] * len(records)
    links = links if links is not None else [None] * len(records)
    if not len(records) == len(ranks) == len(reasons) == len(links):
        raise MtpBenchError(
            f"{len(records)} records with {len(ranks)} ranks, {len(reasons)} reasons and {len(links)} links: "
            "expected one of each per record"
        )
    entries = [
        Entry(record, rank, "" if rank is not None else why or why_unranked(record), link, i in added)
        for i, (record, rank, why, link) in enumerate(zip(records, ranks, reasons, links, strict=True))
    ]
    one_ranking = [entry for listed in by_env(entries).values() for entry in _one_ranking(listed)]
    return sorted(one_ranking, key=_order)


def why_unranked(record: Row) -> str:
    """A sentence on why a record has no rank, as far as the record itself tells."""
    reason = str(record.get("status_reason") or "").strip()
    texts = {
        "partial": "not all scenes were run",
        "crashed": "the agent did not survive its scenes",
        "rejected": "the agent broke the rules",
    }
    status = str(record.get("status"))
    if status in texts:
        return f"{status}: {reason or texts[status]}"
    return "shown, not ranked"


def _one_ranking(entries: Sequence[Entry]) -> list[Entry]:
    """The entries of one environment with the ranks of its main ranking alone."""
    ranked = [entry for entry in entries if entry.rank is not None and entry.record["division"] == "closed"]
    sizes = Counter(_condition(entry) for entry in ranked)
    main = max(sizes, key=lambda condition: (sizes[condition], condition), default=None)
    return [entry if entry in ranked and _condition(entry) == main else _outside(entry) for entry in entries]


def _outside(entry: Entry) -> Entry:
    """An entry that was ranked among others than those of the main ranking, if it was."""
    if entry.rank is None:
        return entry
    if entry.record["division"] == "open":
        return replace(entry, rank=None, why=f"open division: rank {entry.rank} there")
    return replace(entry, rank=None, why="other data, split, card or definitions than the ranked ones")


def _condition(entry: Entry) -> tuple[str, ...]:
    """What entries share that are ranked against each other; the newer definitions first, where sizes are equal."""
    env = entry.record["env"]
    definitions = str(entry.record["scorer"]["definitions"])
    return definitions, *(str(env.get(name)) for name in ("card_digest", "split", "data_manifest"))


def by_env(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The entries of each environment, in their order."""
    boards: dict[str, list[Entry]] = {}
    for entry in entries:
        boards.setdefault(entry.env, []).append(entry)
    return boards


def _order(entry: Entry) -> tuple[Any, ...]:
    rank = math.inf if entry.rank is None else entry.rank
    error = math.inf if entry.error is None else entry.error
    return entry.env, rank, error, entry.name, str(entry.record.get("digest"))
