"""Check a record: schema, digest, what it rests on; score its stored rollouts again, or run the submission again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ...cards import Card, load_card
from ...errors import RecordError
from ...rollouts import load_run
from ...scoring import DEFINITIONS
from ...sources import open_source
from ...types import Rollout
from ..gateway import Limits
from ..loader import load_submission
from .evaluation import Evaluation, Progress, evaluate, status_of
from .provenance import scorer_digest
from .record import LEVELS, Level, Record, ScorerPart, load_record, rollouts_folder, save_record
from .running import plan_run, rollout_digests, run_seed

_CHECKED = ("env", "status", "hypotheses", "reference", "rows", "details", "motion_gap", "per_scene")
TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative


class Difference(NamedTuple):
    """Something that a record says and that was found to be otherwise."""

    what: str
    recorded: Any
    found: Any


@dataclass(frozen=True)
class Verification:
    """What checking one record showed."""

    path: Path
    record: Record
    level: Level  # reached by this check
    differences: tuple[Difference, ...]  # none: the record holds
    notes: tuple[str, ...]  # what changed since and made no difference, in sentences
    updated: Record | None  # with the numbers of today's scorer, where it changed and the rollouts are the record's

    @property
    def holds(self) -> bool:
        """Whether nothing differs."""
        return not self.differences


def verify(
    path: str | Path,
    data: str | None = None,
    env_id: str | None = None,
    submission: str | Path | None = None,
    rerun: bool = False,
    workers: int = 1,
    started: Callable[[int], object] | None = None,
    progress: Progress | None = None,
) -> Verification:
    """Check the record at ``path`` by its stored rollouts: scored again they must give its numbers ("re-scored").

    ``rerun``: by running the submission again instead, whose rollouts must be the same ("re-run"); ``submission`` is
    its folder, None the baseline of that name. ``env_id`` names the card of an env that does not ship. Raises
    RecordError where the record is missing, was changed or has no stored rollouts, DataError where data is missing.
    """
    path = Path(path)
    record = load_record(path)
    card = load_card(env_id or record.env.id)
    stale = _card_differences(record, card)
    if stale:
        return Verification(path, record, "scored", stale, (), None)
    if started is not None:
        started(len(record.per_scene) * (1 + len(record.seeds) if rerun else 1))
    if rerun:
        runs = _rerun(path, record, env_id or record.env.id, submission, data, workers, progress)
    else:
        runs = _stored(path, record)
    changed = _rollout_differences(record, runs)
    if changed:
        return Verification(path, record, "scored", changed, (), None)
    found = _evaluate(record, card, data, runs, workers, progress)
    again = _with(record, found, len(open_source(card, data).names))
    differences = _differences(record, again, timed=not rerun)
    level: Level = "scored" if differences else "re-run" if rerun else "re-scored"
    same_task = not any(difference.what.startswith("env.") for difference in differences)
    updated = again if again.scorer != record.scorer and same_task else None
    return Verification(path, record, level, differences, _notes(record), updated)


def confirm(checked: Verification) -> Record:
    """Write what a check showed into the record: its level, or the numbers of today's scorer where that changed.

    Raises RecordError where the record differs for another reason than a changed scorer.
    """
    record = checked.updated or checked.record
    if checked.differences and checked.updated is None:
        raise RecordError(f"{checked.path}: differs, and not because the scorer changed: make the record again")
    reached: Level = "re-scored" if checked.differences else checked.level  # by today's scorer, from its own rollouts
    level = max(reached, record.verification, key=LEVELS.index)
    return save_record(record.model_copy(update={"verification": level}), checked.path)


def _stored(path: Path, record: Record) -> dict[int, list[Rollout]]:
    """The stored rollouts of each seed, in the order of ``per_scene``."""
    runs = {}
    for seed in record.seeds:
        folder = rollouts_folder(path, seed)
        if not folder.is_dir():
            raise RecordError(
                f"{path}: its rollouts of seed {seed} are not stored at {folder}; run the submission again with --rerun"
            )
        run = load_run(folder)
        for what, said, expected in (
            ("card", run.info.card_digest, record.env.card_digest),
            ("submission", run.info.submission_digest, record.submission.digest),
            ("seed", run.info.seed, seed),
        ):
            if said != expected:
                raise RecordError(f"{folder}: made with {what} {said!r}, the record {path.name} says {expected!r}")
        runs[seed] = _in_order(record, {rollout.scene: rollout for rollout in run.rollouts}, folder)
    return runs


def _in_order(record: Record, found: Mapping[str, Rollout], where: Path) -> list[Rollout]:
    names = [scene.scene for scene in record.per_scene]
    if set(names) != set(found) or len(names) != len(set(names)):
        odd = sorted(set(names) ^ set(found))
        raise RecordError(
            f"{where}: its scenes are not those of the record: {', '.join(odd[:5]) or 'one occurs twice'}"
        )
    return [found[name] for name in names]


def _rerun(
    path: Path,
    record: Record,
    env_id: str,
    folder: str | Path | None,
    data: str | None,
    workers: int,
    progress: Progress | None,
) -> dict[int, list[Rollout]]:
    """Rollouts of the submission under every seed of the record."""
    submission = load_submission(folder or record.submission.name)
    if submission.digest != record.submission.digest:
        raise RecordError(
            f"{path}: made by {record.submission.name!r} with digest {record.submission.digest[:12]}, the submission "
            f"{submission.name!r} has {submission.digest[:12]}; name the right folder with --submission"
        )
    plan = plan_run(submission, env_id, data, len(record.per_scene))
    if list(plan.scenes) != [scene.scene for scene in record.per_scene]:
        raise RecordError(f"{path}: its scenes are not the first {len(record.per_scene)} of {env_id}")
    runs = {seed: run_seed(plan, seed, workers, progress, Limits()) for seed in record.seeds}
    return {seed: [run.rollout for run in results] for seed, results in runs.items()}


def _card_differences(record: Record, card: Card) -> tuple[Difference, ...]:
    pairs = (
        ("env.id", record.env.id, card.id),
        ("env.card_digest", record.env.card_digest, card.digest),
        ("env.split", record.env.split, card.source.split),
    )
    return tuple(Difference(*pair) for pair in pairs if pair[1] != pair[2])


def _rollout_differences(record: Record, runs: Mapping[int, Sequence[Rollout]]) -> tuple[Difference, ...]:
    return tuple(_unequal("rollout_digests", record.rollout_digests, rollout_digests(runs)))


def _evaluate(
    record: Record,
    card: Card,
    data: str | None,
    runs: Mapping[int, Sequence[Rollout]],
    workers: int,
    progress: Progress | None,
) -> Evaluation:
    declared = record.submission.parameters.get("hypotheses")
    hypotheses = declared if isinstance(declared, int) and not isinstance(declared, bool) else None
    ideal = record.env.observe == "truth"
    return evaluate(record.submission.name, card, data, runs, hypotheses, ideal, workers, progress)


def _with(record: Record, found: Evaluation, scenes_of_split: int) -> Record:
    """The record with what the evaluation found, under today's scorer."""
    scenes = len(found.per_scene)
    status, reason = status_of(
        found.motion_gap,
        scenes,
        scenes_of_split,
        record.missed.crashed_scenes,
        scenes * len(record.seeds),
        next(iter(record.missed.reasons.values()), ""),
    )
    env = {"scenes": scenes, "scenes_of_split": scenes_of_split, "data_manifest": found.data_manifest}
    return record.model_copy(
        update={
            "env": record.env.model_copy(update={**env, "truth_complete": found.truth_complete}),
            "scorer": ScorerPart(definitions=DEFINITIONS, source_digest=scorer_digest()),
            "reference": found.reference,
            "status": status,
            "status_reason": reason,
            "hypotheses": found.hypotheses,
            "rows": found.rows,
            "details": found.details,
            "motion_gap": found.motion_gap,
            "per_scene": found.per_scene,
        }
    )


def _differences(record: Record, again: Record, timed: bool) -> tuple[Difference, ...]:
    """What the record says otherwise than ``again``; ``timed``: the rollouts still hold the times of the run."""
    here, there = (
        {name: content for name, content in part.model_dump(mode="json").items() if name in _CHECKED}
        for part in (record, again)
    )
    found = _unequal("", here, there)
    return tuple(difference for difference in found if timed or not difference.what.endswith("ms_per_frame"))


def _notes(record: Record) -> tuple[str, ...]:
    notes = []
    if record.scorer.definitions != DEFINITIONS:
        notes.append(f"scored by definitions {record.scorer.definitions}, today's are {DEFINITIONS}")
    if record.scorer.source_digest != scorer_digest():
        notes.append("the source of the scorer changed since; --write takes over the numbers of today's")
    return tuple(notes)


def _unequal(where: str, recorded: Any, found: Any) -> Iterator[Difference]:
    """The leaves in which two contents of JSON differ, numbers by more than TOLERANCE."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for name in dict.fromkeys([*recorded, *found]):
            path = f"{where}.{name}" if where else name
            yield from _unequal(path, recorded.get(name), found.get(name))
    elif isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        for index, (one, other) in enumerate(zip(recorded, found, strict=True)):
            yield from _unequal(f"{where}[{index}]", one, other)
    elif not _same(recorded, found):
        yield Difference(where, recorded, found)


def _same(recorded: Any, found: Any) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (recorded, found))
    if numbers:
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(recorded) is type(found) and bool(recorded == found)
