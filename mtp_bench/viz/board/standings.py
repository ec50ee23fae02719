"""Where each record stands on the leaderboard."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from ...records.ranking import STP, conditions, record_gap
from ...records.record import Record
from ...scoring.subsets import SUBSETS, Subset
from .entries import Entry, by_env

TRUTH = "truth_past"


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
    gaps = {subset: record_gap(record, stp, truth, subset) for subset in SUBSETS}
    return {subset: gap.closed for subset, gap in gaps.items() if gap is not None}


def _order(entry: Entry) -> tuple[str, float, float, str, str]:
    rank = math.inf if entry.rank is None else entry.rank
    error = math.inf if entry.error is None else entry.error
    return entry.env, rank, error, entry.name, entry.record.digest
