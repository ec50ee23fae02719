"""Records against each other, from their errors per scene alone: paired differences and shared ranks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordError
from ..scoring.definitions import MOST_FORECASTS, RANKED_OBJECTS
from ..scoring.statistics import paired_interval, shared_ranks, sign_flip_test
from ..scoring.subsets import SUBSETS
from .record import Record

Array = NDArray[np.float64]
STP = "stp"


class MissingAware(NamedTuple):
    """Difference of two missing-aware errors over the same targets, in metres."""

    difference: float
    low: float | None  # of the 95 % interval over resampled scenes; None with fewer than two scenes
    high: float | None
    p: float  # of the sign-flip test over scenes


def paired(a: Record, b: Record, subset: str = "all") -> MissingAware:
    """Error of ``a`` less that of ``b`` on one subset; each is the mean over its own seeds.

    Raises RecordError unless both were scored by the same definitions on the same targets, or where there is none.
    """
    if _comparable(a) != _comparable(b):
        raise RecordError(f"{_name(a)} and {_name(b)} cannot be paired: {_differing(a, b)}")
    count = _counts(a, subset)
    if not np.array_equal(count, _counts(b, subset)):
        raise RecordError(f"{_name(a)} and {_name(b)} have different targets in the subset {subset!r}")
    if count.sum() == 0:
        raise RecordError(f"{_name(a)} and {_name(b)} have no target in the subset {subset!r}")
    first, second = _errors(a, subset), _errors(b, subset)
    low, high = paired_interval(first, second, count) or (None, None)
    difference = float((first - second).sum() / count.sum())
    return MissingAware(difference, low, high, sign_flip_test(first - second))


def ranks(records: Sequence[Record]) -> dict[str, dict[str, int | None]]:
    """Rank per subset of each record, by its digest; None: shown, never ranked.

    Only records of one env, card, data, definitions and division are ranked against each other. Those whose paired
    interval covers 0 share a rank. A subset with too few objects is not ranked.
    """
    found: dict[str, dict[str, int | None]] = {record.digest: dict.fromkeys(SUBSETS) for record in records}
    groups: dict[tuple[object, ...], list[Record]] = {}
    for record in records:
        if why_unranked(record, records) is None:
            groups.setdefault((record.division, *_comparable(record)), []).append(record)
    for group in groups.values():
        for subset in SUBSETS:
            if not _rankable(group, subset):
                continue
            places = shared_ranks([_errors(record, subset) for record in group], _counts(group[0], subset))
            for record, place in zip(group, places, strict=True):
                found[record.digest][subset] = place
    return found


def why_unranked(record: Record, records: Sequence[Record] = ()) -> str | None:
    """Why a record is shown, never ranked, in a few words; None where it is ranked.

    ``records`` are those beside it: where false forecasts cost nothing because the truth is not complete, an agent that
    forecasts far more objects than STP is not ranked either.
    """
    if record.status != "finished":
        return f"{record.status}: {record.status_reason}"
    if record.missed.crashed_scenes:  # where false forecasts outweigh the right ones, saying no more would gain
        return f"{record.missed.crashed_scenes} of {len(record.seals)} scenes and seeds were cut short"
    if record.env.observe == "truth":
        return "saw the truth"
    if record.row.budget != "equal":
        return f"{record.samples} samples per object, not the env's own k"
    stp = next((r for r in records if r.submission.name == STP and _comparable(r) == _comparable(record)), None)
    if stp is not None and not record.env.truth_complete and _forecasts(record) > MOST_FORECASTS * _forecasts(stp):
        return f"forecasts more than {MOST_FORECASTS:g} times as many objects as {STP}, where false ones cost nothing"
    return None


def _rankable(group: Sequence[Record], subset: str) -> bool:
    """Whether all records of a group have enough objects, and the same targets, in a subset."""
    objects = next((row.objects for row in group[0].rows if row.subset == subset), 0)
    count = _counts(group[0], subset)
    same = all(np.array_equal(_counts(record, subset), count) for record in group)
    return same and count.sum() > 0 and objects >= RANKED_OBJECTS


def _comparable(record: Record) -> tuple[object, ...]:
    """What two records must share to be paired."""
    return tuple(_conditions(record).values())


def _conditions(record: Record) -> dict[str, object]:
    env = record.env
    return {
        "env": env.id,
        "card": env.card_digest,
        "split": env.split,
        "data": env.data_manifest,
        "definitions": record.scorer.definitions,
        "subsets": record.reference.hash,
        "scenes": tuple(scene.scene for scene in record.per_scene),
    }


def _differing(a: Record, b: Record) -> str:
    here, there = _conditions(a), _conditions(b)
    names = [name for name in here if here[name] != there[name]]
    return f"they differ in {', '.join(names)}"


def _counts(record: Record, subset: str) -> Array:
    return np.array([scene.counts.get(subset, 0) for scene in record.per_scene], dtype=np.float64)


def _errors(record: Record, subset: str) -> Array:
    """Missing-aware error per scene [S], summed over targets, mean over seeds."""
    return np.array([np.mean(scene.errors[subset]) if subset in scene.errors else 0.0 for scene in record.per_scene])


def _forecasts(record: Record) -> float:
    return float(record.details.get("forecasts_per_frame") or 0.0)


def _name(record: Record) -> str:
    return f"{record.submission.name} on {record.env.id}"
