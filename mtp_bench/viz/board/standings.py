"""Where each record stands on the leaderboard, and why some stand nowhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

from ...errors import MtpBenchError
from .entries import Entry, Row, by_env, condition_of
from .gaps import with_gaps


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
    standing = [entry for listed in by_env(entries).values() for entry in with_gaps(_one_ranking(listed))]
    return sorted(standing, key=_order)


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
    sizes = Counter(condition_of(entry) for entry in ranked)
    main = max(sizes, key=lambda condition: (sizes[condition], condition), default=None)
    return [entry if entry in ranked and condition_of(entry) == main else _outside(entry) for entry in entries]


def _outside(entry: Entry) -> Entry:
    """An entry that was ranked among others than those of the main ranking, if it was."""
    if entry.rank is None:
        return entry
    if entry.record["division"] == "open":
        return replace(entry, rank=None, why=f"open division: rank {entry.rank} there")
    return replace(entry, rank=None, why="other data, split, card or definitions than the ranked ones")


def _order(entry: Entry) -> tuple[Any, ...]:
    rank = math.inf if entry.rank is None else entry.rank
    error = math.inf if entry.error is None else entry.error
    return entry.env, rank, error, entry.name, str(entry.record.get("digest"))
