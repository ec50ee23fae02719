"""What a record says follows from what else it says: rows from sums of units, counts from names, status from runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ..scoring.rows import Row
from ..scoring.statistics import bootstrap_interval, effective_number, ratio
from ..scoring.subsets import SUBSETS
from .bounds import MOST_DETAILS, MOST_UNITS
from .canonical import canonical
from .evaluation import status_of
from .record import HiddenPart, Record, ScenePart, key_of
from .shipped import shipped

_CLOSE = 1e-6  # share of a number by which one that follows may differ: other machines sum in another order
_BESIDE_OTHERS = (  # known only beside other agents, or measured
    "rank", "unranked_because", "gap_closed", "gap_interval", "gap_closed_same_predictor",
    "gap_same_predictor_interval", "ms_per_frame",
)  # fmt: skip
_ERRORS = ("error", "localisation", "missed", "error_by_score", "plain_error")  # m, none above a miss
_LENGTHS = (*_ERRORS, "minADE", "minFDE", "fixed_error")


def inconsistencies(record: Record) -> Iterator[str]:
    """What in a record does not fit the rest of it, each in a sentence; none where it holds together."""
    yield from _counts(record)
    ships = shipped(record.env.id)
    most = ships.most if ships is not None and ships.card == record.env.card_digest else math.inf
    for scene in record.per_scene:
        yield from _of_scene(scene)
    yield from sums_that_do_not_fit(record, most)
    for row in record.rows:
        scenes = sum(sum(scene.weight[row.subset]) > 0 for scene in record.per_scene)
        if row.scenes != scenes:
            yield f"row {row.subset!r}: scenes is {row.scenes}, {scenes} have weight"
        yield from _of_setting(row, record)
    if record.silence is not None and not 0 <= record.silence <= most * (1 + _CLOSE):
        yield f"silence is {record.silence}, expected 0 to {most:g} m"
    if len(canonical(record.details)) > MOST_DETAILS:
        yield f"details take {len(canonical(record.details))} bytes, expected at most {MOST_DETAILS}"


def sums_that_do_not_fit(sums: Record | HiddenPart, most: float) -> Iterator[str]:
    """What in rows does not follow from the sums of their units, and sums that no agent can have."""
    subsets = [row.subset for row in sums.rows]
    if subsets != list(SUBSETS):
        yield f"rows are of {', '.join(subsets) or 'no subset'}, expected {', '.join(SUBSETS)}"
        return
    units = {len(of_units(subset)) for subset in SUBSETS for of_units in (sums.unit_weight, sums.unit_error)}
    if len(units) != 1 or units == {0}:
        yield "the sums of units are not one per subset and unit"
        return
    if max(units) > MOST_UNITS:  # their intervals would take the memory of whoever reads them
        yield f"there are sums of {max(units)} units, expected at most {MOST_UNITS}"
        return
    for row in sums.rows:
        weight, error = sums.unit_weight(row.subset), sums.unit_error(row.subset)
        limits = [most * w if w > 0 else 0.0 for w in weight]
        units_of = zip(weight, error, limits, strict=True)
        beyond = next(((w, e) for w, e, limit in units_of if e > limit * (1 + _CLOSE)), None)
        if beyond is not None:
            w, e = beyond
            yield f"subset {row.subset!r}: a unit of weight {w:g} has the error {e:g}, expected 0 to {most:g} x weight"
            return
        yield from _of_row(row, weight, error, sums.row_of("all").targets, most)


def _counts(record: Record) -> Iterator[str]:
    names, seeds = [scene.scene for scene in record.per_scene], record.seeds
    if len(set(names)) != len(names) or len(names) != record.env.scenes:
        yield f"per_scene has {len(names)} scenes, expected {record.env.scenes}, each once"
    if record.env.scenes > record.env.scenes_of_split:
        yield f"scenes is {record.env.scenes}, the split has {record.env.scenes_of_split}"
    if not seeds or len(set(seeds)) != len(seeds):
        yield f"seeds are {seeds}, expected whole numbers from 0 on, each once"
    keys = {key_of(name, seed) for name in names for seed in seeds}
    lost = record.missed
    if not set(lost.reasons) <= keys or lost.crashed_scenes != len(lost.reasons):
        yield f"missed.crashed_scenes is {lost.crashed_scenes}, reasons are given for {len(lost.reasons)}"
    env, split = record.env, record.env.keywords.get("split")
    status = status_of(env.scenes, env.scenes_of_split, lost.crashed_scenes, len(keys), lost.reasons, split)
    if status != (record.status, record.status_reason):
        yield f"status is {record.status!r} ({record.status_reason}), its runs give {status[0]!r} ({status[1]})"


def _of_scene(scene: ScenePart) -> Iterator[str]:
    sums = [part.get(subset, []) for part in (scene.weight, scene.error) for subset in SUBSETS]
    if {len(of_units) for of_units in sums} != {max(1, len(sums[0]))}:
        yield f"per_scene of {scene.scene!r} lacks sums, expected one of 0 or more per subset and unit"


def _of_setting(row: Row, record: Record) -> Iterator[str]:
    """What a row repeats of the record."""
    said = (row.agent, row.hypotheses, row.samples, row.seeds)
    expected = (record.submission.name, record.hypotheses, record.samples, len(record.seeds))
    if said != expected:
        yield f"row {row.subset!r}: agent, hypotheses, samples and seeds are {said}, the record says {expected}"


def _of_row(row: Row, weight: Sequence[float], error: Sequence[float], targets: int, most: float) -> Iterator[str]:
    where, total = f"row {row.subset!r}", sum(weight)
    interval = bootstrap_interval(error, weight) or (None, None)
    for name, said, found in (
        ("error", row.error, ratio(sum(error), total)),
        ("effective_units", row.effective_units, effective_number(weight)),
        *zip(("interval from", "interval to"), row.interval or (None, None), interval, strict=True),
        ("localisation + missed", row.error, _plus(row.localisation, row.missed)),
    ):
        if not _close(said, found):
            yield f"{where}: {name} is {said}, the sums of its units give {found}"
    if row.subset == "all" and row.targets != round(total):
        yield f"{where}: targets is {row.targets}, the sums of its units give {round(total)}"
    if not total * (1 - _CLOSE) <= row.targets <= targets:
        yield f"{where}: targets is {row.targets}, expected {math.ceil(total)} to {targets}"
    for name, value, least, largest in (
        ("coverage", row.coverage, 0.0, 1.0),
        ("p", row.p, 0.0, 1.0),
        ("difference_to_stp", row.difference_to_stp, 0.0, 0.0),  # alone: stp itself, or not known
        ("effective_targets", row.effective_targets, 0.0, row.targets),
        ("objects", row.objects, 0, row.targets),
        ("effective_objects", row.effective_objects, 0.0, row.objects),
        ("events", row.events, 0.0, math.inf),
        *((name, getattr(row, name), 0.0, most if name in _ERRORS else math.inf) for name in _LENGTHS),
    ):
        if value is not None and not least * (1 - _CLOSE) <= value <= largest * (1 + _CLOSE):
            yield f"{where}: {name} is {value}, expected {least:g} to {largest:g}"
    known = [name for name in _BESIDE_OTHERS if getattr(row, name) is not None]
    if known:
        yield f"{where}: {known[0]} is {getattr(row, known[0])}, expected null: no record can know it alone"


def _plus(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one + other


def _close(said: float | None, found: float | None) -> bool:
    if said is None or found is None:
        return said is found
    return math.isclose(said, found, rel_tol=_CLOSE, abs_tol=_CLOSE)
