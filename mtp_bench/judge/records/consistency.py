"""Full check of a record's file: digests, counts and bounds of its facts."""

import math
from collections.abc import Iterator
from pathlib import Path

from ...cards import load_card
from ...core import RecordError, card_ids, parse_json, read_bounded
from ...scoring import WEIGHTS, Subset, ratio
from .record import HiddenPart, Record, Results, key_of
from .shipped import shipped
from .storage import (
    MAX_BYTES,
    NO_RECORD,
    content_digest,
    measured_digest,
    parse_as,
    with_targets,
)
from .targets import Targets

_CLOSE = 1e-6  # relative tolerance of a number that follows from others
# fields of a row in metres that are at most the error of a missed target
_ERRORS = ("missed", "error_by_score", "plain_error")


def checked_record(path: Path) -> Record:
    """Read the record at ``path`` and check it in full.

    Raises RecordError, naming the file, if it is missing, too large, of another schema,
    holds NaN or a repeated key, does not fit its digests, or holds what cannot be.
    """
    return checked_text(read_bounded(path, MAX_BYTES, RecordError, NO_RECORD), path)


def checked_text(text: str, path: Path) -> Record:
    """Return the record in the text of a file; raises as `checked_record`."""
    where = str(path)
    # refuses what pydantic's own reader of JSON lets pass
    content = parse_json(text, where, RecordError)
    record = parse_as(Record, text, where)
    for what, digest, stated in (
        ("its content", content_digest(content), record.digest),
        ("its section 'measured'", measured_digest(content), record.measured.digest),
    ):
        if digest != stated:
            raise RecordError(
                f"{path}: {what} has the digest {digest[:12]}, the file says "
                f"{stated[:12] or '(empty)'}: it was changed after it was made; make it "
                "again with `mtp-bench submit`"
            )
    record = with_targets(record, path)
    for problem in _problems(record):
        raise RecordError(f"{path}: {problem}")
    return record


def _problems(record: Record) -> Iterator[str]:
    """Yield sentences on parts of a record that contradict each other."""
    yield from _counts(record)
    env_id = record.env.id
    is_drive = record.drives is not None
    if env_id in card_ids() and (load_card(env_id).drive is not None) != is_drive:
        yield (
            f"drives are {'given' if is_drive else 'missing'}, {env_id} is "
            f"{'not ' if is_drive else ''}a closed loop"
        )
    env = shipped(env_id)
    is_shipped = env is not None and env.card == record.env.card_digest
    yield from result_problems(
        record, env.max_error_m if env is not None and is_shipped else math.inf
    )
    stated = record.submission.hypotheses
    if stated not in (None, record.hypotheses):
        yield f"hypotheses is {record.hypotheses}, the submission declares {stated}"


def _counts(record: Record) -> Iterator[str]:
    scenes = record.scenes
    seeds = record.seeds
    if len(set(scenes)) != len(scenes):
        yield f"targets are of {len(scenes)} scenes, expected each once"
    if len(scenes) > record.env.scenes_of_split:
        yield f"scenes is {len(scenes)}, the split has {record.env.scenes_of_split}"
    if not seeds or len(set(seeds)) != len(seeds):
        yield f"seeds are {seeds}, expected whole numbers from 0 on, each once"
    runs = {key_of(scene, seed) for scene in scenes for seed in seeds}
    if others := record.missed.reasons.keys() - runs:
        yield f"missed.reasons has {min(others)!r}, which is not a run of the record"
    if record.drives is not None:
        counts = {len(scores) for scores in record.drives.scores}
        if counts != {len(seeds)}:
            yield f"drives.scores are not {len(seeds)} scores of each scene"


def result_problems(
    results: Record | HiddenPart, max_error_m: float = math.inf
) -> Iterator[str]:
    """Yield sentences on results that cannot be, such as errors beyond ``max_error_m``."""
    yield from _target_problems(results.targets, max_error_m)
    if results.drives is None:
        yield from _error_problems(results, max_error_m)
    else:
        yield from _drive_problems(results)
    for subset, numbers in results.numbers.items():
        for name in _ERRORS:
            if numbers.get(name, 0.0) > max_error_m * (1 + _CLOSE):
                yield (
                    f"numbers.{subset}: {name} is {numbers[name]}, expected 0 to "
                    f"{max_error_m:g}"
                )
        yield from _number_problems(results, subset, numbers)


def _number_problems(
    results: Results, subset: Subset, numbers: dict[str, float]
) -> Iterator[str]:
    where = f"numbers.{subset}"
    if numbers.get("coverage", 0.0) > 1 + _CLOSE:
        yield f"{where}: coverage is {numbers['coverage']}, expected 0 to 1"
    weight = math.fsum(results.unit_weight(subset))
    error = ratio(math.fsum(results.unit_error(subset)), weight) or 0.0
    missed = numbers.get("missed", 0.0)
    if missed > error * (1 + _CLOSE) + _CLOSE:
        yield f"{where}: missed is {missed}, the sums of units give an error of {error}"
    costs = [value for name, value in numbers.items() if name.startswith("cost_")]
    if costs and not math.isclose(sum(costs), missed, rel_tol=_CLOSE, abs_tol=_CLOSE):
        yield f"{where}: the sum of cost_* is {sum(costs)}, missed is {missed}"


def _target_problems(targets: Targets, max_error_m: float) -> Iterator[str]:
    if not targets.units:
        yield "targets have no unit"
        return
    for subset, part in targets.subsets.items():
        where = f"targets.{subset}"
        total = sum(part.weight) * (1 - _CLOSE)
        limits = (
            ("weight", total, part.targets),
            ("effective_targets", part.effective_targets, part.targets),
            ("objects", part.objects, part.targets),
            ("effective_objects", part.effective_objects, part.objects),
        )
        for name, value, largest in limits:
            if value > largest * (1 + _CLOSE):
                yield f"{where}: {name} is {value}, expected at most {largest}"
    part = targets.on("all")
    if part.targets != round(sum(part.weight)):
        yield f"targets.all: targets is {part.targets}, the weights give others"
    nothing = targets.nothing_predicted or 0.0
    if nothing > max_error_m * (1 + _CLOSE):
        yield f"nothing_predicted is {nothing}, expected 0 to {max_error_m:g} m"


def _error_problems(results: Results, max_error_m: float) -> Iterator[str]:
    for subset, errors in results.error.items():
        weight = results.unit_weight(subset)
        for w, e in zip(weight, errors, strict=True):
            if e > (max_error_m * w * (1 + _CLOSE) if w > 0 else 0.0):
                yield (
                    f"error.{subset}: a unit of weight {w:g} has error {e:g}, expected "
                    f"0 to {max_error_m:g} x weight"
                )
                return


def _drive_problems(results: Results) -> Iterator[str]:
    """Yield contradictions between the scores of drives and their mean numbers."""
    drives = results.drives
    if drives is None:
        return
    if results.unit_weight("all") != [1.0] * len(drives.scores):
        yield f"drives.scores are of {len(drives.scores)} scenes, expected each scene"
        return
    scores = [score for scene_scores in drives.scores for score in scene_scores]
    mean = sum(drives.scene_scores) / len(drives.scores)
    share_of_zeros = scores.count(0.0) / max(len(scores), 1)
    if drives.collisions > 100.0 * share_of_zeros * (1 + _CLOSE) + _CLOSE:
        yield (
            f"drives.collisions is {drives.collisions}, and {100 * share_of_zeros:g} % "
            "of the scores are 0"
        )
    # the part of the score that is lost by all else than comfort
    lost = sum(WEIGHTS.values()) * (1.0 - mean)
    lost -= WEIGHTS["comfort"] * (1.0 - drives.comfort)
    least_progress = 1.0 - lost / WEIGHTS["progress"]
    if drives.progress < least_progress - _CLOSE:
        yield f"drives.progress is {drives.progress}, the scores need {least_progress:g}"
