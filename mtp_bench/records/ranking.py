"""Records against each other, from their errors per scene alone: the rules of the scorer, applied to records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..scoring.rank import Entrant, enough_objects, shared_ranks
from ..scoring.rank import why_unranked as why_entrant_unranked
from ..scoring.statistics import Gap, gap_closed
from ..scoring.subsets import SUBSETS, Subset
from .record import Record

if TYPE_CHECKING:
    from ..scoring.statistics import Array

STP = "stp"
Conditions = tuple[str, str, str, str, str, str, tuple[str, ...]]


def ranks(records: Sequence[Record]) -> dict[str, dict[Subset, int | None]]:
    """Rank per subset of each record, by its digest; None: shown, never ranked.

    Only records of one env, card, data, definitions and division are ranked against each other.
    """
    places: dict[str, dict[Subset, int | None]] = {record.digest: dict.fromkeys(SUBSETS) for record in records}
    groups: dict[tuple[str, Conditions], list[Record]] = {}
    for record in records:
        if why_unranked(record, records) is None:
            groups.setdefault((record.division, conditions(record)), []).append(record)
    for group in groups.values():
        for subset in SUBSETS:
            if not _rankable(group, subset):
                continue
            shared = shared_ranks([_errors(record, subset) for record in group], _targets(group[0], subset))
            for record, place in zip(group, shared, strict=True):
                places[record.digest][subset] = place
    return places


def why_unranked(record: Record, records: Sequence[Record] = ()) -> str | None:
    """Why a record is shown, never ranked, in a few words; None where it is ranked. ``records`` are those beside it."""
    same = conditions(record)
    stp = next((r for r in records if r.submission.name == STP and conditions(r) == same), None)
    return why_entrant_unranked(_entrant(record), None if stp is None else _entrant(stp))


def record_gap(record: Record, stp: Record, truth: Record, subset: Subset) -> Gap | None:
    """What ``record`` closes of the gap between ``stp`` and ``truth``, all of one k, on one subset.

    A record holds the sum of its false forecasts alone: they are taken to be spread evenly over the targets.
    """
    targets = _targets(stp, subset)
    if targets.sum() == 0 or not all(np.array_equal(_targets(each, subset), targets) for each in (record, truth)):
        return None
    error, high, low = (_errors(each, subset) - _false_errors(each, subset) for each in (record, stp, truth))
    return gap_closed(error, high, low, targets)


def conditions(record: Record) -> Conditions:
    """What two records must share to be ranked against each other, the definitions first."""
    env, scenes = record.env, tuple(part.scene for part in record.per_scene)
    return (
        record.scorer.definitions,
        env.id,
        env.card_digest,
        env.split,
        env.data_manifest,
        record.reference.hash,
        scenes,
    )


def _entrant(record: Record) -> Entrant:
    unfinished = ""
    if record.status != "finished":
        unfinished = f"{record.status}: {record.status_reason}"
    elif record.missed.crashed_scenes:  # where false forecasts outweigh the right ones, saying no more would gain
        unfinished = f"{record.missed.crashed_scenes} of {len(record.seals)} scenes and seeds were cut short"
    return Entrant(
        budget=record.row.budget,
        samples=record.samples,
        saw_truth=record.env.observe == "truth",
        truth_complete=record.env.truth_complete,
        forecasts=record.forecasts_per_frame,
        unfinished=unfinished,
    )


def _rankable(group: Sequence[Record], subset: Subset) -> bool:
    """Whether all records of a group have enough objects, and the same targets, in a subset."""
    objects = next((row.objects for row in group[0].rows if row.subset == subset), 0)
    count = _targets(group[0], subset)
    same = all(np.array_equal(_targets(record, subset), count) for record in group)
    return same and count.sum() > 0 and enough_objects(objects)


def _targets(record: Record, subset: Subset) -> Array:
    """Number of targets of each scene [S]."""
    return np.array([scene.counts.get(subset, 0) for scene in record.per_scene], dtype=np.float64)


def _errors(record: Record, subset: Subset) -> Array:
    """Missing-aware error of each scene [S], summed over its targets, mean over seeds."""
    return np.array([np.mean(scene.errors[subset]) if subset in scene.errors else 0.0 for scene in record.per_scene])


def _false_errors(record: Record, subset: Subset) -> Array:
    """The part of the error of each scene [S] that false forecasts make."""
    share = record.parts.get("false", 0.0)
    return share * _targets(record, subset) if subset == "all" else np.zeros(len(record.per_scene))
