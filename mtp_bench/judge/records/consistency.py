"""Full check of a record's file: digests, counts and bounds of its facts."""

import math
from collections.abc import Iterator
from itertools import chain, product, starmap
from pathlib import Path

from ...cards import load_card
from ...core import RecordError, card_ids, parse_json, read_bounded, validate_json
from ...scoring import DRIVE_SCORE_WEIGHTS, Subset, ratio
from .record import HiddenPart, Record, key_of
from .results import DrivesPart, Results
from .shipped import shipped
from .storage import (
    MAX_BYTES,
    NO_RECORD,
    content_digest,
    measured_digest,
    with_targets,
)
from .targets import UnitTargets

_TOLERANCE = 1e-6  # relative tolerance of a number that follows from others
# fields of a row in metres that are at most the error of a missed target
_ERRORS = ("missed", "error_by_score", "plain_error")


def checked_record(path: Path) -> Record:
    """Read the record at ``path`` and check it in full.

    Raises RecordError, naming the file, if it is missing, too large, of another schema,
    holds NaN or a repeated key, does not fit its digests, or holds what cannot be.
    """
    return checked_text(read_bounded(path, MAX_BYTES, RecordError, NO_RECORD), path)


def checked_text(text: str, path: Path) -> Record:
    """Return the record in the text of a file.

    Raises as `checked_record`.
    """
    where = str(path)
    # refuses what pydantic's own reader of JSON lets pass
    file_content = parse_json(text, where, RecordError)
    record = validate_json(Record, text, where, RecordError)
    for what, digest, stored_digest in (
        ("its content", content_digest(file_content), record.digest),
        (
            "its section 'measured'",
            measured_digest(file_content),
            record.measured.digest,
        ),
    ):
        if digest != stored_digest:
            raise RecordError(
                f"{path}: {what} has the digest {digest[:12]}, the file says "
                f"{stored_digest[:12] or '(empty)'}: it was changed after it was made; "
                "make it again with `mtp-bench submit`"
            )
    record = with_targets(record, path)
    if problem := next(_problems(record), None):
        raise RecordError(f"{path}: {problem}")
    return record


def _problems(record: Record) -> Iterator[str]:
    """Yield sentences on parts of a record that contradict each other."""
    yield from _run_problems(record)
    env_id = record.env.id
    if env_id in card_ids():
        is_loop = load_card(env_id).drive is not None
        if is_loop and record.drives is None:
            yield f"drives are missing, {env_id} is a closed loop"
        if record.drives is not None and not is_loop:
            yield f"drives are given, {env_id} is not a closed loop"
    shipped_env = shipped(env_id)
    max_error_m = math.inf
    if shipped_env is not None and shipped_env.card == record.env.card_digest:
        max_error_m = shipped_env.max_error_m
    yield from result_problems(record, max_error_m)
    declared = record.submission.hypotheses
    if declared not in (None, record.hypotheses):
        yield f"hypotheses is {record.hypotheses}, the submission declares {declared}"


def _run_problems(record: Record) -> Iterator[str]:
    scene_names = record.scenes
    seeds = record.seeds
    if len(set(scene_names)) != len(scene_names):
        yield f"targets are of {len(scene_names)} scenes, expected each once"
    if len(scene_names) > record.env.scenes_of_split:
        yield (
            f"scenes is {len(scene_names)}, the split has {record.env.scenes_of_split}"
        )
    if not seeds or len(set(seeds)) != len(seeds):
        yield f"seeds are {seeds}, expected whole numbers from 0 on, each once"
    run_keys = set(starmap(key_of, product(scene_names, seeds)))
    if unknown_keys := record.missed.reasons.keys() - run_keys:
        yield f"missed.reasons has {min(unknown_keys)!r}, which is not a run of the record"
    drives = record.drives
    if drives is not None and set(map(len, drives.scores)) != {len(seeds)}:
        yield f"drives.scores are not {len(seeds)} scores of each scene"


def result_problems(
    results: Record | HiddenPart, max_error_m: float = math.inf
) -> Iterator[str]:
    """Yield sentences on results that cannot be, such as large errors."""
    yield from _target_problems(results.targets, max_error_m)
    if results.drives is None:
        yield from _error_problems(results, max_error_m)
    else:
        yield from _drive_problems(results.drives, results.unit_weight("all"))
    for subset, numbers in results.numbers.items():
        for name in _ERRORS:
            if numbers.get(name, 0.0) > max_error_m * (1 + _TOLERANCE):
                yield (
                    f"numbers.{subset}: {name} is {numbers[name]}, expected 0 to "
                    f"{max_error_m:g}"
                )
        yield from _number_problems(results, subset, numbers)


def _number_problems(
    results: Results, subset: Subset, numbers: dict[str, float]
) -> Iterator[str]:
    section_name = f"numbers.{subset}"
    if numbers.get("coverage", 0.0) > 1 + _TOLERANCE:
        yield f"{section_name}: coverage is {numbers['coverage']}, expected 0 to 1"
    unit_weights = math.fsum(results.unit_weight(subset))
    error = ratio(math.fsum(results.unit_error(subset)), unit_weights) or 0.0
    missed = numbers.get("missed", 0.0)
    if missed > error * (1 + _TOLERANCE) + _TOLERANCE:
        yield (
            f"{section_name}: missed is {missed}, the sums of units give an error of "
            f"{error}"
        )
    costs = [value for name, value in numbers.items() if name.startswith("cost_")]
    if costs and not math.isclose(
        sum(costs), missed, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE
    ):
        yield f"{section_name}: the sum of cost_* is {sum(costs)}, missed is {missed}"


def _target_problems(targets: UnitTargets, max_error_m: float) -> Iterator[str]:
    if not targets.units:
        yield "targets have no unit"
        return
    for subset, part in targets.subsets.items():
        section_name = f"targets.{subset}"
        total = sum(part.weight) * (1 - _TOLERANCE)
        limits = (
            ("weight", total, part.targets),
            ("effective_targets", part.effective_targets, part.targets),
            ("objects", part.objects, part.targets),
            ("effective_objects", part.effective_objects, part.objects),
        )
        for name, value, largest in limits:
            if value > largest * (1 + _TOLERANCE):
                yield f"{section_name}: {name} is {value}, expected at most {largest}"
    part = targets.on("all")
    if part.targets != round(sum(part.weight)):
        yield f"targets.all: targets is {part.targets}, the weights give others"
    nothing = targets.nothing_predicted or 0.0
    if nothing > max_error_m * (1 + _TOLERANCE):
        yield f"nothing_predicted is {nothing}, expected 0 to {max_error_m:g} m"


def _error_problems(results: Results, max_error_m: float) -> Iterator[str]:
    for subset, unit_errors in results.error.items():
        unit_weights = results.unit_weight(subset)
        for unit_weight, unit_error in zip(unit_weights, unit_errors, strict=True):
            max_error = 0.0
            if unit_weight > 0:
                max_error = max_error_m * unit_weight * (1 + _TOLERANCE)
            if unit_error > max_error:
                yield (
                    f"error.{subset}: a unit of weight {unit_weight:g} has error "
                    f"{unit_error:g}, expected 0 to {max_error_m:g} x weight"
                )
                return


def _drive_problems(drives: DrivesPart, weight: list[float]) -> Iterator[str]:
    """Yield contradictions between the scores of drives and their mean numbers."""
    if weight != [1.0] * len(drives.scores):
        yield f"drives.scores are of {len(drives.scores)} scenes, expected each scene"
        return
    scores = list(chain.from_iterable(drives.scores))
    mean_score = sum(drives.scene_scores) / len(drives.scores)
    # a collision at fault makes a score 0
    share_of_zeros = scores.count(0.0) / max(len(scores), 1)
    if drives.collisions > 100.0 * share_of_zeros * (1 + _TOLERANCE) + _TOLERANCE:
        yield (
            f"drives.collisions is {drives.collisions}, and {100 * share_of_zeros:g} % "
            "of the scores are 0"
        )
    # The score is a weighted mean: all that it lacks, but for comfort, is the most that
    # progress can lack.
    lost_score = sum(DRIVE_SCORE_WEIGHTS.values()) * (1.0 - mean_score)
    lost_score -= DRIVE_SCORE_WEIGHTS["comfort"] * (1.0 - drives.comfort)
    least_progress = 1.0 - lost_score / DRIVE_SCORE_WEIGHTS["progress"]
    if drives.progress < least_progress - _TOLERANCE:
        yield (
            f"drives.progress is {drives.progress}, the scores need {least_progress:g}"
        )
