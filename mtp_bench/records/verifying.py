"""Verify a record: in itself, by its stored rollouts scored again, or by its submission run again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from ..cards import Card
from ..errors import RecordError
from ..gateway import Limits
from ..gateway.sandbox import sandbox_backend
from ..running.options import DEFAULTS, RunOptions
from ..running.reference import reference_for
from ..scoring import DEFINITIONS, Reference
from ..sources import open_source
from ..submission.loader import load_submission
from ..submission.manifest import MANIFEST
from ..types import Rollout
from .attestation import LEVELS, Level, SignedLevel, Statement, bound_to, read_level, write_level
from .canonical import Difference, differences, today
from .consistency import checked_record
from .eligibility import SEEDS
from .evaluation import Evaluation, evaluate, scorer_digest
from .record import HiddenPart, IsolationPart, LimitsPart, Record
from .rerun import rows_under_random_pose, run_again, run_hidden, why_unsandboxed, worse_when_moved
from .running import Plan, Runs, hashes, isolation, latency, plan_run, rollouts_hash, rollouts_of, unanswered
from .seal import Sealed
from .shipped import baseline_digest
from .storage import save_record, stored_rollouts
from .submitting import declared_data, submission_part
from .trust import Trust, trusted

# Fields of a record that follow from rollouts, card and data
_RESCORED = {
    "env", "status", "status_reason", "hypotheses", "samples", "measured", "reference", "rows", "silence", "details",
    "per_scene",
}  # fmt: skip


@dataclass(frozen=True)
class Verification:
    """Result of the check of one record."""

    path: Path
    record: Record
    level: Level  # reached by this check
    differences: tuple[Difference, ...] = ()  # empty: the record holds
    notes: tuple[str, ...] = ()  # sentences
    updated: Record | None = None  # with the numbers of today's scorer and weights, if these changed
    hidden: HiddenPart | None = None  # results on hidden scenes
    isolation: IsolationPart | None = None  # of the agent when it was run again
    ran_again: str | None = None  # date of the run, if an earlier level shows it

    @property
    def holds(self) -> bool:
        """True if there is no difference."""
        return not self.differences


@dataclass(frozen=True)
class Round:
    """The same check of many records, each with its submission and its seal."""

    rerun: bool = False
    seals: Mapping[str, Sealed] = field(default_factory=dict)  # by env: with hidden scenes, which rank simulated envs
    submissions: Path | None = None  # folder of submissions by their names
    submission: Path | None = None  # the one to run, whatever its name
    stated_limits: bool = False
    no_sandbox: bool = False
    only_hidden: bool = False  # do not repeat a run that a signed level shows

    def sealed(self, record: Record) -> Sealed | None:
        """Hidden scenes for a record; None: it is not run on any."""
        return self.seals.get(record.env.id) if self.rerun else None

    def folder(self, record: Record) -> Path | None:
        """Folder of the submission of a record; None: it is the baseline of that name."""
        if self.submission is not None or self.submissions is None:
            return self.submission
        folder = self.submissions / record.submission.name
        return folder if (folder / MANIFEST).is_file() else None

    def shown(self, path: Path, record: Record, trust: Trust) -> SignedLevel | None:
        """The signed level that makes another run unnecessary; None: run it."""
        signed, _ = read_level(path, record, trust) if self.only_hidden else (None, "")
        return signed if signed is not None and LEVELS.index(signed.level) >= LEVELS.index("re-run") else None

    def done(self, path: Path, record: Record, trust: Trust) -> SignedLevel | None:
        """The signed level of a record if it is as high as this check can reach, on the same seal; else None."""
        signed, _ = read_level(path, record, trust)
        sealed = self.sealed(record)
        aim: Level = "re-scored" if not self.rerun else "re-run" if sealed is None else "hidden"
        if signed is None or LEVELS.index(signed.level) < LEVELS.index(aim):
            return None
        if sealed is not None and (signed.hidden is None or signed.hidden.commitment != sealed.commitment):
            return None
        return signed


def verify(
    path: str | Path,
    options: RunOptions = DEFAULTS,
    env_id: str | None = None,
    submission: str | Path | None = None,
    rerun: bool = False,
    sealed: Sealed | None = None,
    ends: ExitStack | None = None,
    stated_limits: bool = False,
    no_sandbox: bool = False,
    shown: SignedLevel | None = None,
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
        ends: Deletes the hidden scenes when it is closed, so that several checks make them once; None: they are deleted
            at the end of this check.
        stated_limits: Run it again with all seeds and under the limits that it states, also if these are more than
            those of records that rank; graphics cards are one.
        no_sandbox: Run it again also without a sandbox: it then has the rights of the caller.
        shown: A signed level of this record that ran it again. If the scorer and the event weights are still those of
            the record, it runs on the hidden scenes of ``sealed`` alone.

    A record of an earlier version is checked in itself alone. Raises RecordError if the record is missing, was changed
    or has no stored rollouts, states more than was allowed, or would run a stranger's code unsandboxed; DataError if
    data is missing.
    """
    path = Path(path)
    record = checked_record(path)
    again = rerun or sealed is not None
    if record.earlier_version:
        return _check_earlier(path, record, again)
    options = replace(options, split=_split(path, record), scenes=None)
    card = options.card(env_id or record.env.id)
    stale = _card_differences(record, card)
    if stale:
        return Verification(path, record, "scored", stale)
    if again and not no_sandbox:
        _require_sandbox(path, record, options)
    limits = _limits(path, record, stated_limits) if again else Limits()
    plan = _plan(path, record, env_id, submission, options) if again else None
    stored = {} if again else stored_rollouts(path, record)
    reference = reference_for(card, [scene.scene for scene in record.per_scene], options)
    if shown is not None and (sealed is None or _notes(record, reference)):
        shown = None
    options.progress.started(_work(record, plan, sealed, shown))
    if plan is None:
        return _score_again(path, record, card, stored, reference, options)
    with ExitStack() as own:
        ends = own if ends is None else ends
        if sealed is not None and shown is not None:
            return _run_hidden_only(path, record, plan, sealed, ends, limits, shown)
        return _run_again(path, record, plan, reference, sealed, ends, limits)


def attest(checked: Verification, key: Path, signer: str, trust: Trust | None = None) -> Path:
    """Sign the level that a check reached and write it beside the record; the path of the file.

    ``trust``: the trusted leaderboard; None: the one that ships. Raises RecordError if the record does not hold or has
    a higher level, MtpBenchError if it cannot be signed.
    """
    record = checked.record
    known, _ = read_level(checked.path, record, trust or trusted())
    if known is not None and LEVELS.index(checked.level) < LEVELS.index(known.level):
        raise RecordError(
            f"{checked.path}: reached {checked.level}, and is {known.level} since {known.statement.date}: that is kept"
        )
    if checked.level == "scored" or not checked.holds:
        raise RecordError(f"{checked.path}: does not hold, so there is no level to sign")
    statement = Statement(
        level=checked.level,
        isolation=(checked.isolation or record.isolation).mechanism,
        date=today(),
        ran_again=checked.ran_again,
        hidden=checked.hidden,
        **bound_to(record),
    )
    return write_level(checked.path, statement, key, signer)


def confirm(checked: Verification) -> Record:
    """Write today's numbers if scorer or weights changed.

    Raises RecordError if the record differs for another reason.
    """
    if checked.differences and checked.updated is None:
        raise RecordError(f"{checked.path}: differs, and not because scorer or weights changed: make the record again")
    return save_record(checked.updated or checked.record, checked.path)


def _check_earlier(path: Path, record: Record, again: bool) -> Verification:
    """Check a record of an earlier version, whose digests are not comparable with today's."""
    if again:
        raise RecordError(
            f"{path}: made by version {record.earlier_version}, which this version cannot run again: make it again "
            "with `mtp-bench submit`"
        )
    note = f"made by version {record.earlier_version}: checked in itself, its rollouts are not scored again"
    return Verification(path, record, "scored", notes=(note,))


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
    changed = tuple(differences("hashes.rollouts", record.hashes.rollouts, rollouts_hash(runs)))
    if changed:
        return Verification(path, record, "scored", changed)
    truth = record.env.observe == "truth"
    evaluation = evaluate(record.submission.name, card, options, runs, reference, record.submission.hypotheses, truth)
    scored = _rescored(record, evaluation, runs, len(open_source(card, options.data).names), times_differ)
    parts = (each.model_dump(mode="json", include=_RESCORED) for each in (record, scored))
    unequal = tuple(differences("", *parts))
    same_task = not any(difference.what.startswith("env.") for difference in unequal)
    other_rules = (scored.scorer, scored.reference) != (record.scorer, record.reference)
    updated = scored if other_rules and same_task else None
    level: Level = "scored" if unequal else "re-scored"
    return Verification(path, record, level, unequal, _notes(record, reference), updated)


def _rescored(
    record: Record,
    evaluation: Evaluation,
    runs: Mapping[int, Sequence[Rollout]],
    scenes_of_split: int,
    times_differ: bool,
) -> Record:
    """The record with the numbers of the evaluation, under today's scorer."""
    scenes, every = len(evaluation.per_scene), [rollout for rollouts in runs.values() for rollout in rollouts]
    env = {
        "scenes": scenes,
        "scenes_of_split": scenes_of_split,
        "data_manifest": evaluation.data_manifest,
        "truth_complete": evaluation.truth_complete,
    }
    times = {} if times_differ else {"latency": latency(every), "ms_per_frame": evaluation.ms_per_frame}
    changed = {
        **evaluation.record_parts(record.missed, scenes * len(record.seeds), scenes_of_split, record.env.keywords),
        "samples": every[0].forecast.shape[1],
        "env": record.env.model_copy(update=env),
        "measured": record.measured.model_copy(update=times),
    }
    return record.model_copy(update=changed)


def _run_again(
    path: Path,
    record: Record,
    plan: Plan,
    reference: Reference,
    sealed: Sealed | None,
    ends: ExitStack,
    limits: Limits,
) -> Verification:
    """The check by running the submission: as in the record, under a secret motion, and on hidden scenes."""
    runs = run_again(plan, record.seeds, limits)
    now = isolation(runs)
    late = unanswered(runs).late
    if late and plan.options.workers.count > 1:
        raise RecordError(
            f"{path}: {late} of its answers came late here, so the run confirms nothing: check it with --jobs 1"
        )
    changed = tuple(_differences_on_rerun(record, plan, runs, limits))
    if changed:
        return Verification(path, record, "scored", changed, isolation=now)
    checked = _score_again(path, record, plan.card, rollouts_of(runs), reference, plan.options, times_differ=True)
    checked = replace(checked, isolation=now)
    if not checked.holds:
        return checked
    why = why_unsandboxed(record, now)
    if why:
        return replace(checked, notes=(*checked.notes, f"limited to level 're-scored': {why}"))
    moved = worse_when_moved(record, rows_under_random_pose(plan, reference, limits))
    if moved is not None:
        return replace(checked, level="scored", differences=(moved,), updated=None)
    if sealed is None:
        return replace(checked, level="re-run")
    return replace(checked, level="hidden", hidden=run_hidden(plan, record, sealed, limits, ends))


def _run_hidden_only(
    path: Path, record: Record, plan: Plan, sealed: Sealed, ends: ExitStack, limits: Limits, shown: SignedLevel
) -> Verification:
    """The check on hidden scenes of a record that was run again before, as a signed level shows."""
    ran = shown.statement.ran_again or shown.statement.date
    then = record.isolation.model_copy(update={"mechanism": shown.statement.isolation})
    hidden = run_hidden(plan, record, sealed, limits, ends)
    note = f"run again on {ran}, as {shown.signer} signed, and on hidden scenes now"
    return Verification(path, record, "hidden", notes=(note,), hidden=hidden, isolation=then, ran_again=ran)


def _require_sandbox(path: Path, record: Record, options: RunOptions) -> None:
    """Raise RecordError if a stranger's code would be run without a sandbox."""
    known = baseline_digest(record.submission.name, record.submission.networks) == record.submission.digest
    if not known and options.workers.scheduler is None and sandbox_backend() == "none":
        raise RecordError(
            f"{path}: no sandbox is available here, so {record.submission.name!r} would run with your rights; install "
            "bubblewrap, or pass --no-sandbox if you trust this code"
        )


def _limits(path: Path, record: Record, stated: bool) -> Limits:
    """Limits for running the submission of a record again.

    RecordError if they are more than ranks need and were not allowed, and if no run can confirm the record.
    """
    if record.missed.late:
        raise RecordError(f"{path}: answers came late when it was made, which no other run repeats: make it again")
    if len(record.seeds) > len(SEEDS) and not stated:
        raise RecordError(
            f"{path}: has {len(record.seeds)} seeds, ranks need {len(SEEDS)}: pass --stated-limits to run all of them"
        )
    if record.division == "closed":
        return Limits()
    limits = Limits(**record.limits.model_dump())
    usual = asdict(Limits())
    more = [f"{name} {value}" for name, value in asdict(limits).items() if value > usual[name]]
    if more and not stated:
        raise RecordError(
            f"{path}: states higher limits than records that rank ({', '.join(more)}): pass --stated-limits to run it "
            "under these"
        )
    return limits


def _differences_on_rerun(record: Record, plan: Plan, runs: Runs, limits: Limits) -> Iterator[Difference]:
    """Differences between a record and another run of its submission, but for numbers that are scored."""
    yield from differences("hashes", record.hashes.model_dump(), hashes(runs).model_dump())
    submission = submission_part(plan, record.submission.commit)
    yield from differences("submission", record.submission.model_dump(), submission.model_dump())
    yield from differences("env.observe", record.env.observe, plan.submission.compare.observe)
    yield from differences("env.keywords", record.env.keywords, plan.stated_keywords)
    yield from differences("limits", record.limits.model_dump(), LimitsPart(**asdict(limits)).model_dump())
    declared = declared_data(plan.submission, record.env.id)  # `submit --training-data` adds to it
    if not set(declared) <= set(record.training_data):
        yield Difference("training_data", record.training_data, declared)
    counts = {"late", "malformed", "crashed_scenes"}
    yield from differences("missed", *(part.model_dump(include=counts) for part in (record.missed, unanswered(runs))))


def _work(record: Record, plan: Plan | None, sealed: Sealed | None, shown: SignedLevel | None) -> int:
    """Number of runs and scenes to score, for a progress bar."""
    hidden = 0 if sealed is None else sealed.seeds.count
    runs = 0 if plan is None else len(record.seeds) + 1
    return hidden + (len(record.per_scene) * (1 + runs) if shown is None else 0)


def _plan(path: Path, record: Record, env_id: str | None, folder: str | Path | None, options: RunOptions) -> Plan:
    """The plan that runs the submission of a record again; RecordError for another submission or other scenes."""
    env_id = env_id or record.env.id
    submission = load_submission(folder or record.submission.name)
    if submission.compare.observe != "tracks":  # in a round only some submissions observe the stored tracks
        options = replace(options, track_file=None)
    plan = plan_run(submission, env_id, replace(options, scenes=len(record.per_scene)))
    if plan.image.digest != record.submission.digest:
        networks = ", ".join(record.submission.networks)
        weights = f", and the weights {networks} with MTP_BENCH_WEIGHTS" if networks else ""
        raise RecordError(
            f"{path}: made by {record.submission.name!r} with digest {record.submission.digest[:12]}, the submission "
            f"{submission.name!r} has {plan.image.digest[:12]}; name the right folder with --submission{weights}"
        )
    if list(plan.scenes) != [scene.scene for scene in record.per_scene]:
        raise RecordError(f"{path}: its scenes are not the first {len(record.per_scene)} of {env_id}")
    return plan


def _split(path: Path, record: Record) -> str | None:
    """The split that was run if it is not the env's."""
    split = record.env.keywords.get("split")
    if split is not None and not isinstance(split, str):
        raise RecordError(f"{path}: split is {split!r}, expected a name")
    return split


def _card_differences(record: Record, card: Card) -> tuple[Difference, ...]:
    pairs = (
        ("env.id", record.env.id, card.id),
        ("env.card_digest", record.env.card_digest, card.digest),
        ("env.split", record.env.split, card.source.split),
    )
    return tuple(Difference(*pair) for pair in pairs if pair[1] != pair[2])


def _notes(record: Record, reference: Reference) -> tuple[str, ...]:
    notes = []
    if record.scorer.definitions != DEFINITIONS:
        notes.append(f"scored by definitions {record.scorer.definitions}, today's are {DEFINITIONS}")
    changed = {
        "the scorer": record.scorer.source_digest != scorer_digest(),
        "the event weights": record.reference.hash != reference.digest,
    }
    notes += [f"{what} changed since; --write takes over today's numbers" for what, other in changed.items() if other]
    return tuple(notes)
