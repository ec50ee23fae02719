"""Verify a record: in itself, by its stored rollouts scored again, or by its submission run again."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...agent import MANIFEST, load_submission
from ...cards import Card
from ...core import RecordError, Rollout, parallel_map
from ...running import DEFAULTS, RunOptions, reference_for
from ...scoring import Reference
from ...sources import open_source
from ..gateway.limits import Isolation, Limits
from ..gateway.sandbox import sandbox_backend
from .attestation import SignedLevel, Statement, read_level, write_level
from .canonical import Difference, differences, today
from .consistency import checked_record
from .eligibility import SEEDS, may_observe, why_scored_otherwise
from .evaluation import evaluate
from .fields import LEVELS, Level
from .record import HiddenPart, LimitsPart, Record
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
from .shipped import FOR_BASELINES, baseline_digest
from .storage import ROLLOUTS, load_record, stored_rollouts
from .submitting import declared_data, is_of_plan, plan_content, submission_part
from .trust import Trust, trusted

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
    isolation: Isolation | None = None  # of the agent when it was run again

    @property
    def holds(self) -> bool:
        """True if there is no difference."""
        return not self.differences


@dataclass(frozen=True)
class Round:
    """The same check of many records, each with its submission and its seal."""

    rerun: bool = False
    seals: Mapping[str, Sealed] = field(
        default_factory=dict
    )  # by env: with hidden scenes, which rank simulated envs
    submission: Path | None = (
        None  # a submission, or a folder of submissions by their names; None: the baselines
    )
    made_here: bool = False  # records of baselines are this maintainer's own: their public runs are not repeated

    def verify(
        self,
        path: Path,
        record: Record,
        options: RunOptions,
        env_id: str | None,
        ends: ExitStack,
    ) -> Verification:
        """Check one record as `verify` does."""
        folder, sealed = self._folder(record), self._sealed(record)
        return verify(
            path, options, env_id, folder, self.rerun, sealed, ends, self.made_here
        )

    def reached(self, path: Path, record: Record, trust: Trust) -> SignedLevel | None:
        """The signed level of a record if it is as high as this check can reach, on the same seal; else None."""
        signed, _ = read_level(path, record, trust)
        sealed = self._sealed(record)
        aim: Level = (
            "re-scored" if not self.rerun else "re-run" if sealed is None else "hidden"
        )
        if signed is None or signed.statement.converted:
            return None
        if LEVELS.index(signed.statement.level) < LEVELS.index(aim):
            return None
        if (
            sealed is not None
            and getattr(signed.statement.hidden, "commitment", None)
            != sealed.commitment
        ):
            return None
        return signed

    def _sealed(self, record: Record) -> Sealed | None:
        return self.seals.get(record.env.id) if self.rerun else None

    def _folder(self, record: Record) -> Path | None:
        """Folder of the submission of a record; None: it is the baseline of that name."""
        if self.submission is None or (self.submission / MANIFEST).is_file():
            return self.submission
        folder = self.submission / record.submission.name
        return folder if (folder / MANIFEST).is_file() else None


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
    """Check a record in itself and by its stored rollouts: scored again they must give its numbers ("re-scored").

    Args:
        path: The record.
        options: Data, workers and progress; all else is as in the record.
        env_id: Card of an env that does not ship.
        submission: Folder of the submission, to run it again; None: the baseline of that name.
        rerun: Run the submission again instead: its rollouts must be the same, and under a secret seed it must score
            alike ("re-run"). An unsandboxed agent reaches "re-scored" at most.
        sealed: Run it on hidden scenes too ("hidden").
        ends: Deletes the hidden scenes when it is closed, shared by several checks; None: at the end of this check.
        made_here: You made this record of a baseline: its public runs are not repeated, and scored again if stored.

    Raises RecordError if the record is missing, was changed, has too many seeds or no stored rollouts to be scored
    again, or would run a stranger's code unsandboxed; DataError for missing data.
    """
    path = Path(path)
    record = checked_record(path)
    if not may_observe(record):
        raise RecordError(
            f"{path}: {FOR_BASELINES}, not of {record.submission.name!r} with another digest"
        )
    again = rerun or sealed is not None
    options = replace(options, split=None, scenes=None)
    card = options.card(env_id or record.env.id)
    now = {"id": card.id, "card_digest": card.digest, "split": card.source.split}
    if stale := tuple(differences("env", record.env.model_dump(include={*now}), now)):
        return Verification(path, record, "scored", stale)
    if not again:
        return _score_stored(path, record, card, options)
    name, digest = record.submission.name, record.submission.digest
    ours = baseline_digest(name, record.submission.networks) == digest
    if not ours and options.workers.scheduler is None and sandbox_backend() == "none":
        raise RecordError(
            f"{path}: no sandbox works here, {name!r} would run with your rights: see SECURITY.md"
        )
    if len(record.seeds) > len(SEEDS):
        raise RecordError(
            f"{path}: has {len(record.seeds)} seeds, expected at most {len(SEEDS)} to run it again"
        )
    plan = _plan(path, record, env_id, submission, options)
    if made_here and not (ours and is_of_plan(record, plan_content(plan))):
        raise RecordError(
            f"{path}: not what `mtp-bench submit` makes here of a baseline: leave --made-here out"
        )
    reference = reference_for(card, record.scenes, options)
    secret = len(record.scenes) + (0 if sealed is None else sealed.seeds.count)
    if made_here:
        public = _made_here(path, record, card, options, reference, secret)
    else:
        options.progress.started(secret + len(record.scenes) * (1 + len(record.seeds)))
        public = _run_again(path, record, plan, reference)
    if not public.holds:
        return public
    with ExitStack() as own:
        return _run_in_secret(public, plan, reference, sealed, ends or own)


def attest(
    checked: Verification,
    key: Path,
    signer: str,
    trust: Trust | None = None,
    looked_at: bool = False,
) -> None:
    """Sign the level that a check reached and write it into the file of the record.

    ``trust``: the trusted leaderboard; None: the one that ships. ``looked_at``: a maintainer found that the record may
    be better than ground truth; it stays so. Raises RecordError if the record does not hold, has a higher level or was
    replaced since, MtpBenchError if it cannot be signed.
    """
    record = checked.record
    known, _ = read_level(checked.path, record, trust or trusted())
    if known is not None and LEVELS.index(checked.level) < LEVELS.index(
        known.statement.level
    ):
        stands = f"is {known.statement.level} since {known.statement.date}"
        raise RecordError(
            f"{checked.path}: reached {checked.level}, and {stands}: that is kept"
        )
    if checked.level == "scored" or not checked.holds:
        raise RecordError(
            f"{checked.path}: does not hold, so there is no level to sign"
        )
    if load_record(checked.path) != record:
        raise RecordError(
            f"{checked.path}: was replaced while it was checked: check it again"
        )
    statement = Statement(
        level=checked.level,
        record=record.digest,
        measured=record.measured.digest,
        isolation=(checked.isolation or record.isolation).mechanism,
        date=today(),
        hidden=checked.hidden,
        looked_at=looked_at or (known is not None and known.statement.looked_at),
    )
    write_level(checked.path, statement, key, signer)


def _score_again(
    path: Path,
    record: Record,
    card: Card,
    runs: Mapping[int, Sequence[Rollout]],
    reference: Reference,
    options: RunOptions,
    times_differ: bool = False,
) -> Verification:
    """Check a record by scoring rollouts: stored ones, or those of another run, whose ``times_differ``."""
    if changed := tuple(
        differences("hashes.rollouts", record.hashes.rollouts, rollouts_hash(runs))
    ):
        return Verification(path, record, "scored", changed)
    name, hypotheses, observe = (
        record.submission.name,
        record.submission.hypotheses,
        record.env.observe,
    )
    evaluation = evaluate(
        name,
        card,
        options,
        runs,
        reference,
        hypotheses,
        observe,
        record.subsets,
    )
    every = [rollout for rollouts in runs.values() for rollout in rollouts]
    scenes_of_split = len(open_source(card, options.data).names)
    env = {
        "scenes_of_split": scenes_of_split,
        "data_manifest": evaluation.data_manifest,
        "truth_complete": evaluation.truth_complete,
    }
    times = (
        {}
        if times_differ
        else {"latency": latency(every), "ms_per_frame": evaluation.ms_per_frame}
    )
    scored = {
        **evaluation.record_fields,
        "env": record.env.model_copy(update=env),
        "measured": record.measured.model_copy(update=times),
    }
    if (
        reference.digest == record.reference.hash
    ):  # these weights may have been frozen since
        scored["reference"] = record.reference
    now = record.model_copy(update=scored)
    unequal = tuple(differences("", _rescored(record), _rescored(now)))
    return Verification(
        path,
        record,
        "scored" if unequal else "re-scored",
        unequal,
        _notes(record, reference),
    )


def _rescored(record: Record) -> dict[str, Any]:
    """Return the fields that scoring gives again, as JSON, on subsets with results."""
    content = record.model_dump(mode="json", include=_RESCORED)
    subsets = content["targets"]["subsets"]
    content["targets"]["subsets"] = {name: subsets.get(name) for name in record.subsets}
    return content


def _score_stored(
    path: Path, record: Record, card: Card, options: RunOptions, further: int = 0
) -> Verification:
    """Check a record by its stored rollouts, scored again; ``further`` secret runs of what was made here follow."""
    runs = stored_rollouts(path, record)
    reference = reference_for(card, record.scenes, options)
    options.progress.started(len(record.scenes) + further)
    if (
        card.drive is not None and not further
    ):  # those of a maintainer are as they were driven
        calls = {
            seed: [(card, rollout) for rollout in rollouts]
            for seed, rollouts in runs.items()
        }
        runs = {
            seed: parallel_map(drive_again, each, options.workers)
            for seed, each in calls.items()
        }
    return _score_again(path, record, card, runs, reference, options)


def _made_here(
    path: Path,
    record: Record,
    card: Card,
    options: RunOptions,
    reference: Reference,
    secret: int,
) -> Verification:
    """The public part of a record that a maintainer made: scored again, or as it is where no rollouts are stored."""
    if path.with_suffix(ROLLOUTS).is_dir():
        return _score_stored(path, record, card, options, secret)
    for note in _notes(record, reference):
        raise RecordError(
            f"{path}: its rollouts are not stored here to be scored again; {note}"
        )
    options.progress.started(secret)
    return Verification(
        path,
        record,
        "re-scored",
        notes=("not scored again: its rollouts are not stored here",),
    )


def _run_again(
    path: Path, record: Record, plan: Plan, reference: Reference
) -> Verification:
    """Check a record by running its submission as it was run then."""
    runs = run_again(plan, record.seeds)
    now = isolation(runs)
    if plan.options.workers.count > 1 and any(
        run.status == "hung" for results in runs.values() for run in results
    ):
        raise RecordError(
            f"{path}: an answer came late here, so the run confirms nothing: check it with --jobs 1"
        )
    if changed := tuple(_differences_on_rerun(record, plan, runs)):
        return Verification(path, record, "scored", changed, isolation=now)
    checked = _score_again(
        path,
        record,
        plan.card,
        rollouts_of(runs),
        reference,
        plan.options,
        times_differ=True,
    )
    return replace(checked, isolation=now)


def _run_in_secret(
    public: Verification,
    plan: Plan,
    reference: Reference,
    sealed: Sealed | None,
    ends: ExitStack,
) -> Verification:
    """The check of a record whose ``public`` runs hold, under a secret motion and on hidden scenes."""
    record = public.record
    if why := why_unsandboxed(record, public.isolation or record.isolation):
        return replace(
            public, notes=(*public.notes, f"limited to level 're-scored': {why}")
        )
    moved = worse_when_moved(record, errors_under_random_pose(plan, reference))
    if moved is not None:
        return replace(public, level="scored", differences=(moved,))
    if sealed is None:
        return replace(public, level="re-run")
    return replace(
        public, level="hidden", hidden=run_hidden(plan, record, sealed, ends)
    )


def _differences_on_rerun(
    record: Record, plan: Plan, runs: Runs
) -> Iterator[Difference]:
    """Differences between a record and another run of its submission, but for numbers that are scored."""
    yield from differences(
        "hashes", record.hashes.model_dump(), hashes(runs).model_dump()
    )
    submission = submission_part(plan, record.submission.commit)
    yield from differences(
        "submission", record.submission.model_dump(), submission.model_dump()
    )
    yield from differences(
        "env.observe", record.env.observe, plan.submission.compare.observe
    )
    yield from differences("env.keywords", record.env.keywords, plan.keywords)
    yield from differences(
        "limits",
        record.limits.model_dump(),
        LimitsPart(**asdict(Limits())).model_dump(),
    )
    yield from differences(
        "training_data",
        record.training_data,
        declared_data(plan.submission, record.env.id),
    )
    missed = unanswered(runs)
    counts = ("malformed", "crashed_scenes")
    yield from differences(
        "missed",
        {name: getattr(record.missed, name) for name in counts},
        {name: getattr(missed, name) for name in counts},
    )


def _plan(
    path: Path,
    record: Record,
    env_id: str | None,
    folder: str | Path | None,
    options: RunOptions,
) -> Plan:
    """The plan that runs the submission of a record again; RecordError for another submission or other scenes."""
    env_id = env_id or record.env.id
    submission = load_submission(folder or record.submission.name)
    plan = plan_run(
        submission,
        env_id,
        replace(options, scenes=len(record.scenes), seeds=record.seeds),
    )
    if plan.image.digest != record.submission.digest:
        networks = ", ".join(record.submission.networks)
        weights = (
            f", and the weights {networks} with MTP_BENCH_WEIGHTS" if networks else ""
        )
        raise RecordError(
            f"{path}: made by {record.submission.name!r} with digest {record.submission.digest[:12]}, the submission "
            f"{submission.name!r} has {plan.image.digest[:12]}; name the right folder with --submission{weights}"
        )
    if list(plan.scenes) != record.scenes:
        raise RecordError(
            f"{path}: its scenes are not the first {len(record.scenes)} of {env_id}"
        )
    return plan


def _notes(record: Record, reference: Reference) -> tuple[str, ...]:
    changes = {
        "the scorer": why_scored_otherwise(record) is not None,
        "the event weights": record.reference.hash != reference.digest,
    }
    changed = [what for what, has_changed in changes.items() if has_changed]
    note = f"changed since it was made: {', '.join(changed)}; make it again with `mtp-bench submit`"
    return (note,) if changed else ()
