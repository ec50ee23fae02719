"""Verify a record: in itself, by its stored rollouts, or by its submission run again."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...agent import load_submission
from ...cards import Card
from ...core import RecordError, Rollout, parallel_map
from ...running import DEFAULTS, RunOptions, reference_for
from ...scoring import Reference
from ...sources import open_source
from ..gateway.limits import Isolation, Limits
from ..gateway.sandbox import sandbox_backend
from .canonical import Difference, differences
from .consistency import checked_record
from .eligibility import SEEDS, is_baseline, may_observe, why_scored_otherwise
from .evaluation import evaluate
from .fields import Level
from .record import HiddenPart, Record
from .rerun import (
    drive_again,
    errors_under_random_pose,
    run_again,
    run_hidden,
    why_unsandboxed,
    worse_when_moved,
)
from .running import (
    Plan,
    Runs,
    hashes,
    isolation,
    latency,
    plan_run,
    rollouts_hash,
    rollouts_of,
    unanswered,
)
from .seal import Sealed
from .shipped import FOR_BASELINES
from .storage import ROLLOUTS_SUFFIX, stored_rollouts
from .submitting import declared_data, is_of_plan, plan_content, submission_part

# fields of a record that follow from rollouts, card and data
_RESCORED = {
    "env",
    "hypotheses",
    "samples",
    "measured",
    "reference",
    "error",
    "numbers",
    "drives",
    "targets",
    "brier",
    "overconfidence",
    "curve",
}


@dataclass(frozen=True)
class Verification:
    """Result of the check of one record."""

    path: Path
    record: Record
    level: Level  # reached by this check
    differences: tuple[Difference, ...] = ()  # empty: the record holds
    notes: tuple[str, ...] = ()  # sentences
    hidden: HiddenPart | None = None  # results on hidden scenes
    isolation: Isolation | None = None  # how the agent was isolated in the new run

    @property
    def holds(self) -> bool:
        """True if there is no difference."""
        return not self.differences


def verify(
    path: str | Path,
    options: RunOptions = DEFAULTS,
    env_id: str | None = None,
    submission: str | Path | None = None,
    rerun: bool = False,
    sealed: Sealed | None = None,
    ends: ExitStack | None = None,
    made_here: bool = False,
) -> Verification:
    """Check a record in itself and by its stored rollouts.

    Scored again the rollouts must give its numbers ("re-scored").

    Args:
        path: The record.
        options: Data, workers and progress; all else is as in the record.
        env_id: Card of an env that does not ship.
        submission: Folder of the submission, to run it again; None: the baseline of
            that name.
        rerun: Run the submission again instead: its rollouts must be the same, and
            under a secret seed it must score alike ("re-run"). An unsandboxed agent
            reaches "re-scored" at most.
        sealed: Run it on hidden scenes too ("hidden").
        ends: Deletes the hidden scenes when it is closed, shared by several checks;
            None: at the end of this check.
        made_here: You made this record of a baseline: its public runs are not repeated,
            and scored again if stored.

    Raises RecordError if the record is missing, was changed, has too many seeds or no
    stored rollouts to be scored again, or would run a stranger's code unsandboxed;
    DataError for missing data.
    """
    path = Path(path)
    record = checked_record(path)
    if not may_observe(record):
        raise RecordError(
            f"{path}: {FOR_BASELINES}, not of {record.submission.name!r} with another "
            "digest"
        )
    options = replace(options, split=None, scenes=None)
    card = options.card(env_id or record.env.id)
    env = {"id": card.id, "card_digest": card.digest, "split": card.source.split}
    if stale := tuple(differences("env", record.env.model_dump(include={*env}), env)):
        return Verification(path, record, "scored", stale)
    if not rerun and sealed is None:
        return _score_stored(path, record, card, options)
    _require_runnable(path, record, options)
    plan = _plan(path, record, env_id, submission, options)
    reference = reference_for(card, record.scenes, options)
    secret_runs = len(record.scenes)  # under a secret motion
    if sealed is not None:
        secret_runs += sealed.seeds.count
    if made_here:
        public = _made_here(path, record, plan, reference, secret_runs)
    else:
        # all seeds are run, then the scenes are scored
        public_runs = len(record.scenes) * (len(record.seeds) + 1)
        options.progress.started(secret_runs + public_runs)
        public = _check_by_rerun(path, record, plan, reference)
    if not public.holds:
        return public
    with ExitStack() as check_ends:
        return _run_in_secret(public, plan, reference, sealed, ends or check_ends)


def _require_runnable(record_file: Path, record: Record, options: RunOptions) -> None:
    """Raise RecordError for a stranger's code without a sandbox, and for many seeds."""
    is_local = options.workers.scheduler is None
    if not is_baseline(record) and is_local and sandbox_backend() == "none":
        raise RecordError(
            f"{record_file}: no sandbox works here, {record.submission.name!r} would "
            "run with "
            "your rights: see SECURITY.md"
        )
    if len(record.seeds) > len(SEEDS):
        raise RecordError(
            f"{record_file}: has {len(record.seeds)} seeds, expected at most "
            f"{len(SEEDS)} to "
            "run it again"
        )


def _score_again(
    record_file: Path,
    record: Record,
    card: Card,
    runs: Mapping[int, Sequence[Rollout]],
    reference: Reference,
    options: RunOptions,
    times_differ: bool = False,
) -> Verification:
    """Check a record by scoring rollouts.

    The rollouts are the stored ones, or those of another run; then ``times_differ``.
    """
    answers = differences(
        "hashes.rollouts", record.hashes.rollouts, rollouts_hash(runs)
    )
    if changed := tuple(answers):
        return Verification(record_file, record, "scored", changed)
    evaluation = evaluate(
        record.submission.name,
        card,
        options,
        runs,
        reference,
        record.submission.hypotheses,
        record.env.observe,
        record.subsets,
    )
    env = {
        "scenes_of_split": len(open_source(card, options.data).names),
        "data_manifest": evaluation.data_manifest,
        "truth_complete": evaluation.truth_complete,
    }
    measured = record.measured
    if not times_differ:
        rollouts = [rollout for seed_runs in runs.values() for rollout in seed_runs]
        times = {"latency": latency(rollouts), "ms_per_frame": evaluation.ms_per_frame}
        measured = measured.model_copy(update=times)
    fields = evaluation.record_fields | {
        "env": record.env.model_copy(update=env),
        "measured": measured,
    }
    # the same weights may have been frozen since, which is not a difference
    if reference.digest == record.reference.hash:
        fields["reference"] = record.reference
    scored_now = record.model_copy(update=fields)
    unequal = tuple(differences("", _rescored(record), _rescored(scored_now)))
    level: Level = "scored" if unequal else "re-scored"
    return Verification(record_file, record, level, unequal, _notes(record, reference))


def _rescored(record: Record) -> dict[str, Any]:
    """Return the fields that scoring gives again, as JSON, on subsets with results."""
    content = record.model_dump(mode="json", include=_RESCORED)
    subsets = content["targets"]["subsets"]
    content["targets"]["subsets"] = {name: subsets.get(name) for name in record.subsets}
    return content


def _score_stored(
    record_file: Path,
    record: Record,
    card: Card,
    options: RunOptions,
    secret_runs: int = 0,
) -> Verification:
    """Check a record by its stored rollouts, scored again.

    ``secret_runs``: number of those that follow, of a record that was made here; 0: it
    was made elsewhere.
    """
    seed_runs = stored_rollouts(record_file, record)
    reference = reference_for(card, record.scenes, options)
    options.progress.started(len(record.scenes) + secret_runs)
    # drives that were not made here are made again from the answers
    if card.drive is not None and not secret_runs:
        for seed, rollouts in seed_runs.items():
            calls = [(card, rollout) for rollout in rollouts]
            seed_runs[seed] = parallel_map(drive_again, calls, options.workers)
    return _score_again(record_file, record, card, seed_runs, reference, options)


def _made_here(
    record_file: Path,
    record: Record,
    plan: Plan,
    reference: Reference,
    secret_runs: int,
) -> Verification:
    """Check the public part of a record that a maintainer made.

    It is scored again, or taken as it is where no rollouts are stored. Raises
    RecordError unless it is what a submit makes here of a baseline.
    """
    options = plan.options
    if not (is_baseline(record) and is_of_plan(record, plan_content(plan))):
        raise RecordError(
            f"{record_file}: not what `mtp-bench submit` makes here of a baseline: "
            "leave "
            "--made-here out"
        )
    if record_file.with_suffix(ROLLOUTS_SUFFIX).is_dir():
        return _score_stored(record_file, record, plan.card, options, secret_runs)
    if notes := _notes(record, reference):
        raise RecordError(
            f"{record_file}: its rollouts are not stored here to be scored again; "
            f"{notes[0]}"
        )
    options.progress.started(secret_runs)
    note = "not scored again: its rollouts are not stored here"
    return Verification(record_file, record, "re-scored", notes=(note,))


def _check_by_rerun(
    record_file: Path, record: Record, plan: Plan, reference: Reference
) -> Verification:
    """Check a record by running its submission as it was run then."""
    seed_runs = run_again(plan, record.seeds)
    statuses = {run.status for seed_runs in seed_runs.values() for run in seed_runs}
    if plan.options.workers.count > 1 and "hung" in statuses:
        raise RecordError(
            f"{record_file}: an answer came late here, so the run confirms nothing: "
            "check it with --jobs 1"
        )
    isolation_now = isolation(seed_runs)
    if changed := tuple(_differences_on_rerun(record, plan, seed_runs)):
        # its numbers are not scored again, since the run itself differs
        return Verification(
            record_file,
            record,
            level="scored",
            differences=changed,
            isolation=isolation_now,
        )
    checked = _score_again(
        record_file,
        record,
        plan.card,
        rollouts_of(seed_runs),
        reference,
        plan.options,
        times_differ=True,
    )
    return replace(checked, isolation=isolation_now)


def _run_in_secret(
    public: Verification,
    plan: Plan,
    reference: Reference,
    sealed: Sealed | None,
    ends: ExitStack,
) -> Verification:
    """Check a record whose ``public`` runs hold under secret motion and hidden scenes."""
    record = public.record
    if why := why_unsandboxed(record, public.isolation or record.isolation):
        note = f"limited to level 're-scored': {why}"
        return replace(public, notes=(*public.notes, note))
    moved = worse_when_moved(record, errors_under_random_pose(plan, reference))
    if moved is not None:
        return replace(public, level="scored", differences=(moved,))
    if sealed is None:
        return replace(public, level="re-run")
    hidden = run_hidden(plan, record, sealed, ends)
    return replace(public, level="hidden", hidden=hidden)


def _differences_on_rerun(
    record: Record, plan: Plan, runs: Runs
) -> Iterator[Difference]:
    """Yield differences of another run, but for numbers that are scored."""
    submission = submission_part(plan, record.submission.commit)
    training_data = declared_data(plan.submission, record.env.id)
    pairs: dict[str, tuple[Any, Any]] = {
        "hashes": (record.hashes.model_dump(), hashes(runs).model_dump()),
        "submission": (record.submission.model_dump(), submission.model_dump()),
        "env.observe": (record.env.observe, plan.submission.compare.observe),
        "env.keywords": (record.env.keywords, plan.keywords),
        "limits": (record.limits.model_dump(), Limits().model_dump()),
        "training_data": (record.training_data, training_data),
    }
    missed = unanswered(runs)
    for name in ("malformed", "crashed_scenes"):
        counts = (getattr(record.missed, name), getattr(missed, name))
        pairs[f"missed.{name}"] = counts
    for where, (recorded, repeated) in pairs.items():
        yield from differences(where, recorded, repeated)


def _plan(
    record_file: Path,
    record: Record,
    env_id: str | None,
    submission_folder: str | Path | None,
    options: RunOptions,
) -> Plan:
    """Return the plan that runs the submission of a record again.

    Raises RecordError for another submission or other scenes.
    """
    env_id = env_id or record.env.id
    submission = load_submission(submission_folder or record.submission.name)
    scenes = record.scenes
    plan_options = replace(options, scenes=len(scenes), seeds=record.seeds)
    plan = plan_run(submission, env_id, plan_options)
    if plan.image.digest != record.submission.digest:
        networks = ", ".join(record.submission.networks)
        hint = ""
        if networks:
            hint = f", and the weights {networks} with MTP_BENCH_WEIGHTS"
        raise RecordError(
            f"{record_file}: made by {record.submission.name!r} with digest "
            f"{record.submission.digest[:12]}, the submission {submission.name!r} has "
            f"{plan.image.digest[:12]}; name the right folder with --submission{hint}"
        )
    if list(plan.scenes) != scenes:
        raise RecordError(
            f"{record_file}: its scenes are not the first {len(scenes)} of {env_id}"
        )
    return plan


def _notes(record: Record, reference: Reference) -> tuple[str, ...]:
    """Return a sentence on what changed since a record was made, if anything did."""
    changed = []
    if why_scored_otherwise(record) is not None:
        changed.append("the scorer")
    if record.reference.hash != reference.digest:
        changed.append("the event weights")
    if not changed:
        return ()
    note = f"changed since it was made: {', '.join(changed)}"
    return (f"{note}; make it again with `mtp-bench submit`",)
