"""Full check of a record's file: digests, and numbers that must follow from its other numbers."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...cards import load_card
from ...core import RecordError, card_ids, parse_json, read_bounded
from ...scoring import (
    PARTS,
    SUBSETS,
    WEIGHTS,
    Row,
    Subset,
    bootstrap_interval,
    effective_number,
    fault_interval,
    ratio,
    score_interval,
)
from .canonical import canonical, differences
from .evaluation import LEFT_OUT, status_of
from .record import HiddenPart, Record, key_of
from .shipped import shipped
from .storage import MOST_BYTES, content_digest, measured_digest, parse_as

MOST_DETAILS = 1 << 20  # bytes of the section ``details``
MOST_UNITS = 2_000  # of a record: blocks of 20 s
_CLOSE = 1e-6  # relative tolerance of a number that follows from others: machines sum in other orders
_CLOSE_ENDS = 1e-3  # of an end of an interval: where units differ by rounding alone, it comes from this rounding
_ERRORS = (
    "error",
    "localisation",
    "missed",
    "error_by_score",
    "plain_error",
)  # m, at most that of a missed target
_LENGTHS = (*_ERRORS, "minADE", "minFDE", "fixed_error")


def checked_record(path: Path) -> Record:
    """Read the record at ``path`` and check it in full.

    Raises RecordError, naming the file, if it is missing, too large, of another schema, holds NaN or a repeated key,
    does not fit its digests, or states a number that does not follow from its other numbers.
    """
    absent = "no such record; `mtp-bench submit` makes one"
    return checked_text(read_bounded(path, MOST_BYTES, RecordError, absent), str(path))


def checked_text(text: str, path: str) -> Record:
    """The record in the text of the file ``path``; raises RecordError as `checked_record`."""
    content = parse_json(
        text, path, RecordError
    )  # refuses what pydantic's own reader of JSON lets pass
    record = parse_as(Record, text, path)
    for what, found, stated in (
        ("its content", content_digest(content), record.digest),
        ("its section 'measured'", measured_digest(content), record.measured.digest),
    ):
        if found != stated:
            raise RecordError(
                f"{path}: {what} has the digest {found[:12]}, the file says {stated[:12] or '(empty)'}: it was changed "
                "after it was made; make it again with `mtp-bench submit`"
            )
    for problem in inconsistencies(record):
        raise RecordError(f"{path}: {problem}")
    return record


def inconsistencies(record: Record) -> Iterator[str]:
    """Sentences on parts of a record that contradict each other."""
    yield from _inconsistent_counts(record)
    env_id, loop = record.env.id, record.driving is not None
    if env_id in card_ids() and (load_card(env_id).drive is not None) != loop:
        yield f"driving is {'given' if loop else 'missing'}, {env_id} is {'not ' * loop}a closed loop"
    ships = shipped(env_id)
    most = (
        ships.most
        if ships is not None and ships.card == record.env.card_digest
        else math.inf
    )
    yield from inconsistent_sums(record, most)
    stated: dict[str, Any] = {
        "agent": record.submission.name,
        "hypotheses": record.hypotheses,
        "samples": record.samples,
        "seeds": len(record.seeds),
    }
    for row in record.rows:
        scenes = sum(
            sum(scene.weight.get(row.subset, ())) > 0 for scene in record.per_scene
        )
        for name, expected in {**stated, "scenes": scenes}.items():
            if getattr(row, name) != expected:
                yield f"row {row.subset!r}: {name} is {getattr(row, name)!r}, the record has {expected!r}"
    if record.submission.hypotheses not in (None, record.hypotheses):
        yield f"hypotheses is {record.hypotheses}, the submission declares {record.submission.hypotheses}"
    if (
        record.nothing_predicted is not None
        and not 0 <= record.nothing_predicted <= most * (1 + _CLOSE)
    ):
        yield f"nothing_predicted is {record.nothing_predicted}, expected 0 to {most:g} m"
    if len(canonical(record.details)) > MOST_DETAILS:
        yield f"details take {len(canonical(record.details))} bytes, expected at most {MOST_DETAILS}"


def inconsistent_sums(sums: Record | HiddenPart, most: float) -> Iterator[str]:
    """Sentences on rows that do not follow from the sums of their units, and on sums beyond ``most`` metres."""
    subsets: set[Subset] = {*SUBSETS, *(row.subset for row in sums.rows)}
    units = {
        len(of_units(subset))
        for subset in subsets
        for of_units in (sums.unit_weight, sums.unit_error)
    }
    if len(units) != 1 or units == {0}:
        yield "the sums of units are not one per subset and unit"
        return
    if max(units) > MOST_UNITS:  # their intervals take memory
        yield f"there are sums of {max(units)} units, expected at most {MOST_UNITS}"
        return
    yield from _inconsistent_driving(sums)
    for row in sums.rows:
        weight, error = sums.unit_weight(row.subset), sums.unit_error(row.subset)
        for w, e in zip(weight, error, strict=True):
            if e > (most * w * (1 + _CLOSE) if w > 0 else 0.0):
                yield f"subset {row.subset!r}: a unit of weight {w:g} has error {e:g}, expected 0 to {most:g} x weight"
                return
        yield from _inconsistent_row(
            row, weight, error, sums.row_of("all").targets, most
        )


def _inconsistent_driving(sums: Record | HiddenPart) -> Iterator[str]:
    if sums.driving is None:
        return
    stated = sums.driving.model_dump(mode="json")
    scores, count, seeds = stated["scores"], len(stated["scores"]), sums.row.seeds
    if sums.unit_weight("all") != [1.0] * count or any(
        len(own) != seeds for own in scores
    ):
        yield f"driving.scores are of {count} scenes, expected {seeds} of each scene"
        return
    mean = [math.fsum(own) / seeds for own in scores]
    interval = score_interval(mean)
    score, none = (
        sum(mean) / count,
        sum(own.count(0.0) for own in scores) / (seeds * count),
    )
    lost = sum(WEIGHTS.values()) * (1.0 - score) - WEIGHTS["comfort"] * (
        1.0 - stated["comfort"]
    )  # by all else
    way = max(stated["progress"], 1.0 - lost / WEIGHTS["progress"] - _CLOSE)
    sure = {
        "agent": sums.row.agent,
        "drive_score": score,
        "interval": interval and list(interval),
        "progress": way,
    }
    sure["collisions"] = min(stated["collisions"], 100.0 * none)
    sure["collisions_interval"] = list(fault_interval(stated["collisions"], count))
    alone = dict.fromkeys(("difference", "difference_interval", "p", "bade"))
    for each in differences(
        "driving", stated, {**stated, **sure, **alone, "scenes": count}
    ):
        yield f"{each.what} is {each.recorded}, the other numbers give {each.found}"
    if any(
        abs(1.0 - score - error) > _CLOSE
        for score, error in zip(mean, sums.unit_error("all"), strict=True)
    ):
        yield "driving.scores and the errors of scenes do not add up to 1"


def _inconsistent_counts(record: Record) -> Iterator[str]:
    names, seeds, env, lost = (
        [scene.scene for scene in record.per_scene],
        record.seeds,
        record.env,
        record.missed,
    )
    if len(set(names)) != len(names) or len(names) != env.scenes:
        yield f"per_scene has {len(names)} scenes, expected {env.scenes}, each once"
    if env.scenes > env.scenes_of_split:
        yield f"scenes is {env.scenes}, the split has {env.scenes_of_split}"
    if not seeds or len(set(seeds)) != len(seeds):
        yield f"seeds are {seeds}, expected whole numbers from 0 on, each once"
    keys = {key_of(name, seed) for name in names for seed in seeds}
    if not set(lost.reasons) <= keys or lost.crashed_scenes != len(lost.reasons):
        yield f"missed.crashed_scenes is {lost.crashed_scenes}, reasons are given for {len(lost.reasons)}"
    status = status_of(env.scenes, env.scenes_of_split, lost, len(keys))
    if status != (record.status, record.status_reason):
        yield f"status is {record.status!r} ({record.status_reason}), its runs give {status[0]!r} ({status[1]})"


def _inconsistent_row(
    row: Row, weight: Sequence[float], error: Sequence[float], targets: int, most: float
) -> Iterator[str]:
    where, total = f"row {row.subset!r}", sum(weight)
    interval = bootstrap_interval(error, weight) or (None, None)
    stated_interval = row.interval or (None, None)
    sums = {
        "localisation + missed": ("localisation", "missed"),
        "the sum of cost_*": [f"cost_{p}" for p in PARTS],
    }
    parts = {
        name: [v for field in fields if (v := getattr(row, field)) is not None]
        for name, fields in sums.items()
    }
    for name, stated, found, close in (
        ("error", row.error, ratio(sum(error), total), _CLOSE),
        ("effective_units", row.effective_units, effective_number(weight), _CLOSE),
        ("interval from", stated_interval[0], interval[0], _CLOSE_ENDS),
        ("interval to", stated_interval[1], interval[1], _CLOSE_ENDS),
        *(
            (name, sum(values), row.error, _CLOSE)
            for name, values in parts.items()
            if values
        ),
    ):
        if (stated is None) != (found is None) or not math.isclose(
            stated or 0.0, found or 0.0, rel_tol=close, abs_tol=close
        ):
            yield f"{where}: {name} is {stated}, the sums of its units give {found}"
    if row.subset == "all" and row.targets != round(total):
        yield f"{where}: targets is {row.targets}, the sums of its units give {round(total)}"
    for name, value, least, largest in (
        ("targets", row.targets, total, targets),
        ("coverage", row.coverage, 0.0, 1.0),
        ("p", row.p, 0.0, 1.0),
        (
            "difference_to_stp",
            row.difference_to_stp,
            0.0,
            0.0,
        ),  # alone: STP itself, or not known
        ("effective_targets", row.effective_targets, 0.0, row.targets),
        ("objects", row.objects, 0, row.targets),
        ("effective_objects", row.effective_objects, 0.0, row.objects),
        ("events", row.events, 0.0, math.inf),
        *(
            (name, getattr(row, name), 0.0, most if name in _ERRORS else math.inf)
            for name in _LENGTHS
        ),
    ):
        if value is not None and not least * (1 - _CLOSE) <= value <= largest * (
            1 + _CLOSE
        ):
            yield f"{where}: {name} is {value}, expected {least:g} to {largest:g}"
    known = next((name for name in LEFT_OUT if getattr(row, name) is not None), None)
    if known is not None:
        yield f"{where}: {known} is {getattr(row, known)}, expected null: it depends on other records"
