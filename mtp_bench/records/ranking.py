"""Records against each other, from their sums per unit alone: the rules of the scorer, applied to records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..scoring.rank import Entrant, guard, ranks_by_test, why_not_on
from ..scoring.rank import why_unranked as why_entrant_unranked
from ..scoring.statistics import gap_closed
from ..scoring.subsets import SUBSETS, Subset
from .record import Record

STP, TRUTH = "stp", "truth_past"
OTHERS = "other data, split, card, weights or definitions than the ranked ones"


@dataclass(frozen=True)
class Place:
    """Where a record stands on one subset."""

    rank: int | None = None
    why: str = ""  # it has no rank


@dataclass(frozen=True)
class Standing:
    """Where a record stands among those of its environment."""

    places: Mapping[Subset, Place]
    compared: bool = False  # with the main ranking of its environment, whether or not that has ranks
    gaps: Mapping[Subset, float] = field(default_factory=dict)  # what it closes of that from STP to true pasts


def standings(records: Sequence[Record]) -> dict[str, Standing]:
    """Where each record stands, by its digest.

    Only records of one env, card, data, weights, definitions and division are ranked against each other. The main
    ranking of an env is the largest one of its closed division: the others are shown beside it.
    """
    found: dict[str, Standing] = {}
    for env_id in dict.fromkeys(record.env.id for record in records):
        found |= _of_env([record for record in records if record.env.id == env_id])
    return found


def why_unranked(record: Record) -> str | None:
    """Why a record is shown, never ranked, in a few words; None where it is ranked."""
    unfinished = ""
    if record.status != "finished":
        unfinished = f"{record.status}: {record.status_reason}"
    elif record.missed.crashed_scenes:
        unfinished = f"{record.missed.crashed_scenes} of {len(record.seals)} scenes and seeds were cut short"
    return why_entrant_unranked(Entrant(record.row.budget, record.samples, record.env.observe == "truth", unfinished))


def conditions(record: Record) -> tuple[object, ...]:
    """What two records must share to be compared with each other: then they have the same units, too."""
    env, targets = record.env, tuple((part.scene, *part.weight["all"]) for part in record.per_scene)
    return (
        record.scorer.definitions,
        env.id,
        env.card_digest,
        env.split,
        env.data_manifest,
        record.reference.hash,
        targets,
    )


def _of_env(records: Sequence[Record]) -> dict[str, Standing]:
    groups: dict[tuple[str, tuple[object, ...]], list[Record]] = {}
    for record in records:
        if why_unranked(record) is None:
            groups.setdefault((record.division, conditions(record)), []).append(record)
    closed = [key for key in groups if key[0] == "closed"]
    main = max(closed, key=lambda key: (len(groups[key]), repr(key)), default=None)
    comparable = [record for record in records if main is not None and conditions(record) == main[1]]
    places = {record.digest: _nowhere(why_unranked(record) or "") for record in records}
    for key, group in groups.items():
        ranked = _places(group, _named(STP, comparable))
        if key != main:
            ranked = [_nowhere(_outside(key[0], place["all"])) for place in ranked]
        places |= {record.digest: place for record, place in zip(group, ranked, strict=True)}
    inside = {record.digest for record in groups.get(main, [])} if main is not None else set()
    gaps = {record.digest: _gaps(record, comparable) for record in comparable}
    return {digest: Standing(place, digest in inside, gaps.get(digest, {})) for digest, place in places.items()}


def _nowhere(why: str) -> dict[Subset, Place]:
    return dict.fromkeys(SUBSETS, Place(why=why))


def _outside(division: str, place: Place) -> str:
    """Why a record has no rank that is ranked among others than those of the main ranking."""
    if division == "closed":
        return OTHERS
    return "open division" + (f": rank {place.rank} there" if place.rank is not None else "")


def _places(group: Sequence[Record], stp: Record | None) -> list[dict[Subset, Place]]:
    """The places of records that are ranked against each other."""
    places: list[dict[Subset, Place]] = [{} for _ in group]
    for subset in SUBSETS:
        nobody = why_not_on(subset, group[0].row_of(subset).effective_objects, group[0].unit_weight(subset))
        limit = None if stp is None or subset == "all" else stp.row.error
        why = [nobody or guard(record.row.error, limit) for record in group]
        ranked = [i for i, reason in enumerate(why) if reason is None]
        ranks = ranks_by_test([group[i].unit_error(subset) for i in ranked]) if ranked else []
        rank = dict(zip(ranked, ranks, strict=True))
        for i, reason in enumerate(why):
            places[i][subset] = Place(rank.get(i), reason or "")
    return places


def _gaps(record: Record, beside: Sequence[Record]) -> dict[Subset, float]:
    """What a record closes of the gap between the records of STP and of true pasts ``beside`` it, all of one k."""
    stp, truth = _named(STP, beside), _named(TRUTH, beside)
    if stp is None or truth is None or len({record.samples, stp.samples, truth.samples}) > 1:
        return {}
    closed: dict[Subset, float] = {}
    for subset in SUBSETS if record.status == "finished" else ():
        error, high, low = (each.unit_error(subset) for each in (record, stp, truth))
        gap = gap_closed(error, high, low, stp.unit_weight(subset))
        if gap is not None:
            closed[subset] = gap.closed
    return closed


def _named(name: str, records: Sequence[Record]) -> Record | None:
    return next((each for each in records if each.submission.name == name and each.status == "finished"), None)
