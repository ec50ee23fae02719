"""Check a record: schema, digest, what it rests on; score its stored rollouts again, or run the submission again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
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
from ..types import Rollout
from .attestation import LEVELS, Level, SignedLevel, Statement, bound_to, read_level, write_level
from .canonical import today
from .eligibility import SEEDS
from .evaluation import Evaluation, evaluate
from .hidden import run_hidden
from .provenance import scorer_digest
from .record import Difference, HiddenPart, IsolationPart, LimitsPart, MeasuredPart, Record, unequal
from .rerun import Runs, rows_when_moved, run_again, why_not_isolated, worse_when_moved
from .running import Plan, hashes, isolation, latency, plan_run, rollouts_hash, rollouts_of, unanswered
from .seal import Sealed
from .shipped import baseline_digest
from .storage import load_record, save_record
from .stored import stored_rollouts
from .submitting import declared_data, judged, said_of
from .trust import Trust, trusted

# The parts of a record that follow from rollouts, card and data.
_CHECKED = ("env", "status", "status_reason", "hypotheses", "samples", "measured", "reference", "rows", "silence",
            "details", "per_scene")  # fmt: skip


@dataclass(frozen=True)
class Verification:
    """What checking one record showed."""

    path: Path
    record: Record
    level: Level  # reached by this check
    differences: tuple[Difference, ...]  # none: the record holds
    notes: tuple[str, ...]  # what else is to be known, in sentences
    updated: Record | None = None  # with the numbers of today's scorer and weights, where these changed
    hidden: HiddenPart | None = None  # what it scored on hidden scenes
    held: IsolationPart | None = None  # what held the agent when it was run again
    ran_again: str | None = None  # when that was, where an earlier level shows it

    @property
    def holds(self) -> bool:
        """Whether nothing differs."""
        return not self.differences


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
    """Check a record by its stored rollouts: scored again they must give its numbers ("re-scored").

    Args:
        path: The record.
        options: Data, workers and progress; all else is as the record says of itself.
        env_id: Card of an env that does not ship.
        submission: Folder of the submission, for running it again; None: the baseline of that name.
        rerun: Run the submission again instead: its rollouts must be the same, and once more under a secret seed it
            must score alike ("re-run"). Where nothing held the agent it is "re-scored" at most.
        sealed: So too, and then on hidden scenes ("hidden").
        ends: Deletes the hidden scenes when it is closed, so that a round makes them once; None: they are deleted at
            the end of this check.
        stated_limits: Run it again with all seeds and under the limits that it states, also where these are more than
            those of records that rank; graphics cards are one.
        no_sandbox: Run it again also where this system can hold no agent: it then has the rights of whoever runs it.
        shown: A signed level of this record that ran it again. Where the scorer and the event weights are still those
            of the record, that is not repeated: it runs on the hidden scenes of ``sealed`` alone.

    Raises RecordError where the record is missing, was changed or has no stored rollouts, states more
    than was allowed, or is of a stranger whom nothing would hold; DataError where data is missing.
    """
    path = Path(path)
    record = load_record(path)
    options = replace(options, split=_split(path, record), scenes=None)
    card = options.card(env_id or record.env.id)
    stale = _card_differences(record, card)
    if stale:
        return Verification(path, record, "scored", stale, ())
    again = rerun or sealed is not None
    if again and not no_sandbox:
        _require_held(path, record, options)
    limits = _limits(path, record, stated_limits) if again else Limits()
    plan = _plan(path, record, env_id, submission, options) if again else None
    stored = {} if again else stored_rollouts(path, record)
    reference = reference_for(card, [scene.scene for scene in record.per_scene], options)
    if shown is not None and (sealed is None or _notes(record, reference)):
        shown = None
    options.progress.started(_work(record, plan, sealed, shown))
    if plan is None:
        return _scored_again(path, record, card, stored, reference, options)
    with ExitStack() as own:
        ends = own if ends is None else ends
        if sealed is not None and shown is not None:
            return _hidden_alone(path, record, plan, sealed, ends, limits, shown)
        return _run_again(path, record, plan, reference, sealed, ends, limits)


def attest(checked: Verification, key: Path, signer: str, trust: Trust | None = None) -> Path:
    """Sign the level that a check reached and write it beside the record; the path of the file.

    ``trust``: whose word counts; None: the leaderboard that ships. Raises RecordError where the record does not hold or
    a higher level is there, MtpBenchError where it cannot be signed.
    """
    record = checked.record
    known, _ = read_level(checked.path, record, trust or trusted())
    if known is not None and LEVELS.index(checked.level) < LEVELS.index(known.level):
        raise RecordError(
            f"{checked.path}: reached {checked.level}, and is {known.level} since {known.statement.date}: that is kept"
        )
    if checked.level == "scored" or not checked.holds:
        raise RecordError(f"{checked.path}: does not hold, so there is no level to sign")
    held = (checked.held or record.isolation).mechanism
    statement = Statement(
        level=checked.level,
        isolation=held,
        date=today(),
        ran_again=checked.ran_again,
        hidden=checked.hidden,
        **bound_to(record),
    )
    return write_level(checked.path, statement, key, signer)


def confirm(checked: Verification) -> Record:
    """Write today's numbers where scorer or weights changed.

    Raises RecordError where the record differs for another reason.
    """
    if checked.differences and checked.updated is None:
        raise RecordError(f"{checked.path}: differs, and not because scorer or weights changed: make the record again")
    return save_record(checked.updated or checked.record, checked.path)


def _scored_again(
    path: Path,
    record: Record,
    card: Card,
    runs: Mapping[int, Sequence[Rollout]],
    reference: Reference,
    options: RunOptions,
    again: Plan | None = None,
) -> Verification:
    """The check by rollouts that are stored, or that were made ``again`` and are the same; their times are others."""
    changed = tuple(unequal("hashes.rollouts", record.hashes.rollouts, rollouts_hash(runs)))
    if changed:
        return Verification(path, record, "scored", changed, ())
    declared = _declared(record) if again is None else again.setting.hypotheses
    truth = record.env.observe == "truth"
    found = evaluate(record.submission.name, card, options, runs, reference, declared, truth)
    scored = _with(record, found, runs, len(open_source(card, options.data).names))
    if again is None:
        scored = scored.model_copy(update={"measured": _times(record, found, runs)})
    parts = (each.model_dump(mode="json", include=set(_CHECKED)) for each in (record, scored))
    differences = tuple(unequal("", *parts))
    same_task = not any(difference.what.startswith("env.") for difference in differences)
    other_rules = (scored.scorer, scored.reference) != (record.scorer, record.reference)
    updated = scored if other_rules and same_task else None
    level: Level = "scored" if differences else "re-scored"
    return Verification(path, record, level, differences, _notes(record, reference), updated)


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
    again = run_again(plan, record.seeds, limits)
    held = isolation(again)
    late = unanswered(again).late
    if late and plan.options.workers.count > 1:
        raise RecordError(f"{path}: {late} of its answers came late here, so nothing is shown: check it with --jobs 1")
    changed = tuple(_said_otherwise(record, plan, again, limits))
    if changed:
        return Verification(path, record, "scored", changed, (), held=held)
    checked = _scored_again(path, record, plan.card, rollouts_of(again), reference, plan.options, plan)
    checked = replace(checked, held=held)
    if not checked.holds:
        return checked
    why = why_not_isolated(record, held)
    if why:
        return replace(checked, notes=(*checked.notes, f"no more than re-scored: {why}"))
    moved = worse_when_moved(record, rows_when_moved(plan, reference, limits))
    if moved is not None:
        return replace(checked, level="scored", differences=(moved,), updated=None)
    if sealed is None:
        return replace(checked, level="re-run")
    return replace(checked, level="hidden", hidden=run_hidden(plan, record, sealed, limits, ends))


def _hidden_alone(
    path: Path, record: Record, plan: Plan, sealed: Sealed, ends: ExitStack, limits: Limits, shown: SignedLevel
) -> Verification:
    """The check on hidden scenes of a record that was run again before, as a signed level shows."""
    ran = shown.statement.ran_again or shown.statement.date
    held = record.isolation.model_copy(update={"mechanism": shown.statement.isolation})
    hidden = run_hidden(plan, record, sealed, limits, ends)
    note = f"run again on {ran}, as {shown.signer} signed, and on hidden scenes now"
    return Verification(path, record, "hidden", (), (note,), hidden=hidden, held=held, ran_again=ran)


def _require_held(path: Path, record: Record, options: RunOptions) -> None:
    """Raise RecordError before a stranger's code is run where nothing would hold it."""
    known = baseline_digest(record.submission.name, record.submission.networks) == record.submission.digest
    if known or options.workers.scheduler is not None or sandbox_backend() != "none":
        return
    raise RecordError(
        f"{path}: no sandbox is available here, so {record.submission.name!r} would run with your rights; install "
        "bubblewrap, or pass --no-sandbox if you trust this code"
    )


def _limits(path: Path, record: Record, stated: bool) -> Limits:
    """What a submission may use in a run again.

    RecordError where that is more than ranks need and nobody allowed it, and where no run can show anything.
    """
    if record.missed.late:
        raise RecordError(f"{path}: answers came late when it was made, which no other run repeats: make it again")
    if len(record.seeds) > len(SEEDS) and not stated:
        raise RecordError(
            f"{path}: has {len(record.seeds)} seeds, ranks need {len(SEEDS)}: say --stated-limits to run all of them"
        )
    if record.division == "closed":
        return Limits()
    limits = Limits(**record.limits.model_dump())
    usual = asdict(Limits())
    more = [f"{name} {value}" for name, value in asdict(limits).items() if value > usual[name]]
    if more and not stated:
        raise RecordError(
            f"{path}: wants more than records that rank ({', '.join(more)}): say --stated-limits to run it under these"
        )
    return limits


def _said_otherwise(record: Record, plan: Plan, again: Runs, limits: Limits) -> Iterator[Difference]:
    """In what a run again differs from what the record says of its own."""
    yield from unequal("hashes", record.hashes.model_dump(), hashes(again).model_dump())
    said = said_of(plan, record.submission.commit)
    yield from unequal("submission", record.submission.model_dump(), said.model_dump())
    yield from unequal("env.observe", record.env.observe, plan.submission.compare.observe)
    yield from unequal("env.keywords", record.env.keywords, plan.stated_keywords)
    yield from unequal("limits", record.limits.model_dump(), LimitsPart(**asdict(limits)).model_dump())
    declared = declared_data(plan.submission, record.env.id)  # `submit --training-data` adds to it
    if not set(declared) <= set(record.training_data):
        yield Difference("training_data", record.training_data, declared)
    if plan.setting.hypotheses is not None:
        yield from unequal("hypotheses", record.hypotheses, plan.setting.hypotheses)
    lost = {"late", "malformed", "crashed_scenes"}
    missed = (part.model_dump(include=lost) for part in (record.missed, unanswered(again)))
    yield from unequal("missed", *missed)


def _work(record: Record, plan: Plan | None, sealed: Sealed | None, shown: SignedLevel | None) -> int:
    """Runs and scenes to score, for a progress bar."""
    runs = 0 if plan is None else len(record.seeds) + 1
    hidden = 0 if sealed is None else sealed.seeds.count * len(sealed.run_seeds(record.seeds))
    return hidden + (len(record.per_scene) * (1 + runs) if shown is None else 0)


def _plan(path: Path, record: Record, env_id: str | None, folder: str | Path | None, options: RunOptions) -> Plan:
    """How the submission of a record is run again; RecordError where it is another one, or the scenes are others."""
    env_id = env_id or record.env.id
    submission = load_submission(folder or record.submission.name)
    if submission.compare.observe != "tracks":  # stored tracks are for those in a round that observe them
        options = replace(options, track_file=None)
    plan = plan_run(submission, env_id, replace(options, scenes=len(record.per_scene)))
    if plan.image.digest != record.submission.digest:
        where = "--submission" + (
            f", and the weights {', '.join(record.submission.networks)} with MTP_BENCH_WEIGHTS"
            if record.submission.networks
            else ""
        )
        raise RecordError(
            f"{path}: made by {record.submission.name!r} with digest {record.submission.digest[:12]}, the submission "
            f"{submission.name!r} has {plan.image.digest[:12]}; name the right folder with {where}"
        )
    if list(plan.scenes) != [scene.scene for scene in record.per_scene]:
        raise RecordError(f"{path}: its scenes are not the first {len(record.per_scene)} of {env_id}")
    return plan


def _split(path: Path, record: Record) -> str | None:
    """The split that was run where it is another one than the env's."""
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


def _declared(record: Record) -> int | None:
    """H where it is a parameter, as the submission declared; None: it is what the answers state."""
    counts = [value for value in record.submission.parameters.values() if type(value) is int]
    return record.hypotheses if record.hypotheses in counts else None


def _with(record: Record, found: Evaluation, runs: Mapping[int, Sequence[Rollout]], scenes_of_split: int) -> Record:
    """The record with what the evaluation found, under today's scorer."""
    scenes, keywords = len(found.per_scene), record.env.keywords
    env = {
        "scenes": scenes,
        "scenes_of_split": scenes_of_split,
        "data_manifest": found.data_manifest,
        "truth_complete": found.truth_complete,
    }
    parts = judged(found, record.missed, scenes * len(record.seeds), scenes_of_split, keywords)
    samples = next(iter(runs.values()))[0].forecast.shape[1]
    return record.model_copy(update={**parts, "samples": samples, "env": record.env.model_copy(update=env)})


def _times(record: Record, found: Evaluation, runs: Mapping[int, Sequence[Rollout]]) -> MeasuredPart:
    """What was measured, with the times of the rollouts."""
    every = [rollout for rollouts in runs.values() for rollout in rollouts]
    times = {"latency": latency(every), "ms_per_frame": found.ms_per_frame}
    return record.measured.model_copy(update=times)


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
