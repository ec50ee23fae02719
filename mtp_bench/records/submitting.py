"""Make a record: run a submission behind the gateway, score it, store what it said beside the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..cards import Card, load_card
from ..errors import DataError, MtpBenchError, RecordError, SubmissionError
from ..files import describe_write_error, require_file, require_folder, whole_file, whole_folder
from ..gateway import Limits, SceneRun, image_of
from ..parallel import parallel_map
from ..running.options import DEFAULTS, RunOptions
from ..running.reference import reference_for
from ..running.rollout_files import require_run_folder, save_run
from ..running.run import library_versions
from ..scoring import DEFINITIONS
from ..strict import parse_json, require_part, validate
from ..submission.loader import Submission, load_submission
from ..submission.manifest import MANIFEST
from .bounds import out_of_bounds, refuse
from .canonical import today
from .eligibility import SEEDS
from .evaluation import Evaluation, status_of
from .parts import Start, open_parts
from .provenance import hardware, scorer_digest
from .record import (
    Division,
    EnvPart,
    HardwarePart,
    LimitsPart,
    MeasuredPart,
    MissedPart,
    Record,
    ScorerPart,
    SubmissionPart,
)
from .running import (
    Plan,
    evaluate_plan,
    hashes,
    info_of,
    isolation,
    latency,
    peak_memory,
    plan_run,
    rollouts_of,
    run_seed,
    unanswered,
)
from .stated import finished_record, stated_before
from .storage import ROLLOUTS, checked, load_record, save_record, seed_folder, written

RECORDS = Path("leaderboard", "records")  # relative to the working folder: the checkout


def submit(
    path: str | Path,
    env_id: str,
    options: RunOptions = DEFAULTS,
    output: str | Path | None = None,
    division: Division = "closed",
    training_data: Sequence[str] = (),
    commit: str = "",
    limits: Limits = Limits(),  # noqa: B008  (frozen)
    start: Start = "new",
    replace: bool = False,
) -> Record:
    """Run a submission on an env behind the gateway, and write its record to ``output``/<env id>.json.

    Args:
        path: Folder of the submission, or name of a baseline.
        env_id: Id of the env or path of its card.
        options: Data, seeds, workers and progress. A part of the scenes, or another split than the env's, makes a
            partial record, which is never ranked. Of a Dask cluster the record names the hardware of one worker.
        output: Folder; None: leaderboard/records/<name of the submission>.
        division: Where the record is ranked.
        training_data: What the submission was trained on beside what its manifest says.
        commit: Hex, the commit that holds the folder; else what its manifest says, which cannot name its own commit. A
            whole record that is resumed is given another one without a run.
        limits: What the agent may use; those of the closed division are fixed.
        start: What becomes of the scenes that an earlier submit of this record finished without coming to its end:
            "new" refuses them, "resume" goes on from them (and takes a whole record of the same plan as it is),
            "fresh" discards them.
        replace: Whether a finished record may give way to one of fewer seeds or scenes, or to one that cannot rank.

    Every scene is kept as soon as it is done. Record and rollouts come together, at the end: until then, and after any
    failure, those of an earlier submit are as they were.

    In every run the local frames are turned and shifted at random: what an agent knows of the scenes by their
    coordinates is of no use. What an agent does is never an error: a submission of which no scene was finished has the
    status "crashed". Raises MtpBenchError for whatever the user can mend, and before anything runs where the output
    cannot be written or a finished record would be lost.
    """
    submission = load_submission(path)
    plan = plan_run(submission, env_id, options)
    target = record_path(submission, load_card(env_id), output, options.split)
    require_writable(target, submission)
    if not replace:
        require_kept(target, options.seeds, len(plan.scenes), division, plan.scenes_of_split)
    _require_causal(division, submission)
    _require_limits(division, limits)
    declared = declared_data(submission, plan.card.id, training_data)
    _require_recordable(plan, limits, division, declared, commit)
    stated = stated_before(plan, limits, division, declared)
    if start == "resume" and (record := finished_record(target, stated)) is not None:
        return record if commit in ("", record.submission.commit) else _renamed(record, plan, commit, target)
    with open_parts(target, stated, start) as parts:
        reference = reference_for(plan.card, plan.scenes, options)
        options.progress.started((len(options.seeds) + 1) * len(plan.scenes))
        runs = {seed: run_seed(plan, seed, limits, parts) for seed in options.seeds}
        _require_unchanged(plan)
        found = evaluate_plan(plan, runs, reference, watched=True)
        _require_one_data(plan, runs, found)
        return _save(target, plan, runs, _record(plan, runs, found, limits, division, declared, commit))


def _renamed(record: Record, plan: Plan, commit: str, target: Path) -> Record:
    """A whole record that names another commit: of its runs nothing changes."""
    return save_record(record.model_copy(update={"submission": said_of(plan, commit)}), target)


def _save(target: Path, plan: Plan, runs: Mapping[int, Sequence[SceneRun]], record: Record) -> Record:
    """Put record and rollouts in the place of earlier ones; whatever can fail comes before the first is replaced."""
    record, text = written(record, target)
    checked(parse_json(text, str(target), RecordError), str(target))  # what cannot be read again is no record
    try:
        with whole_file(target) as file:
            file.write_text(text, encoding="utf-8")
            with whole_folder(target.with_suffix(ROLLOUTS)) as folder:
                for seed, rollouts in rollouts_of(runs).items():
                    save_run(seed_folder(folder, seed), info_of(plan, seed), rollouts)
    except OSError as error:
        raise MtpBenchError(f"cannot write {target}: {describe_write_error(error, target)}") from None
    return record


def _require_unchanged(plan: Plan) -> None:
    """A record is of one submission: what it is of is read before the first scene, and once more after the last."""
    if image_of(load_submission(plan.submission.path), plan.card.id).digest != plan.image.digest:
        raise SubmissionError(
            f"{plan.submission.path}: its files were changed while it was run, expected one submission in all scenes: "
            "submit again with --fresh"
        )


def _require_one_data(plan: Plan, runs: Mapping[int, Sequence[SceneRun]], found: Evaluation) -> None:
    """A record is of one state of the data: scenes that an earlier submit finished were shown what is there now."""
    for results in runs.values():
        for name, run, digest in zip(plan.scenes, results, found.scene_digests, strict=True):
            if run.scene_digest not in ("", digest):  # nothing is known of a part that an earlier version wrote
                raise DataError(
                    f"{name}: its data are others than when {plan.submission.name} was run on it, expected the same in "
                    "all scenes: submit again with --fresh"
                )


def _require_causal(division: str, submission: Submission) -> None:
    """Tracks that were stored before belong to the open division: nothing kept their program from the future."""
    if division == "closed" and submission.compare.observe == "tracks":
        raise MtpBenchError(
            f"{submission.name} observes stored tracks, which may have seen the future: choose the open division; "
            "there it is shown, not ranked"
        )


def _require_limits(division: str, limits: Limits) -> None:
    if division == "closed" and limits != Limits():
        changed = [name for name, value in asdict(limits).items() if value != getattr(Limits(), name)]
        raise MtpBenchError(
            f"the limits of the closed division are fixed, got another {', '.join(changed)}: choose the open division"
        )


def _require_recordable(plan: Plan, limits: Limits, division: str, training_data: Sequence[str], commit: str) -> None:
    """Refuse before the work what no record can hold: a text that is too long, too many seeds."""
    where, card = f"a record of {plan.submission.name} on {plan.card.id}", plan.card
    content = {
        "submission": said_of(plan, commit).model_dump(mode="json"),
        "division": division,
        "training_data": list(training_data),
        "env": {"id": card.id, "split": card.source.split, "keywords": plan.stated_keywords},
        "seeds": list(plan.options.seeds),
        "limits": asdict(limits),
        "per_scene": [{"scene": name} for name in plan.scenes],
    }
    require_part(Record, content, where, RecordError)
    refuse(out_of_bounds(content), where)


def declared_data(submission: Submission, env_id: str, more: Sequence[str] = ()) -> list[str]:
    """What a submission was trained on, as its record on an env declares it; ``more`` than its manifest says."""
    note = submission.note_on(env_id)
    return [*submission.training_data, *more, *([note] if note else [])]


def record_path(submission: Submission, card: Card, output: str | Path | None, split: str | None = None) -> Path:
    """Where the record of a submission on the env of ``card`` goes; on another ``split`` beside the one on its own."""
    folder = RECORDS / submission.name if output is None else Path(output)
    other = "" if split in (None, card.source.split) else f"-{split}"
    return folder / f"{card.id}{other}.json"


def require_writable(target: Path, submission: Submission) -> None:
    """Refuse a record before the work: a part of the submission, no folder, no permission, or no rollouts."""
    if target.resolve().is_relative_to(submission.path):
        raise SubmissionError(
            f"cannot write {target}: it is inside the submission {submission.path}, name another folder"
        )
    require_folder(target)
    if target.parent.is_dir():
        require_file(target)
    if target.with_suffix(ROLLOUTS).exists():
        for folder in target.with_suffix(ROLLOUTS).iterdir():
            require_run_folder(folder)


def require_kept(
    target: Path, seeds: Sequence[int], scenes: int | None, division: Division, scenes_of_split: int | None = None
) -> None:
    """Raise RecordError where a finished record at ``target`` would be lost to a smaller one, or one that cannot rank.

    ``scenes``: None for all. ``scenes_of_split``: how many the split has; None: as many as the record says.
    """
    try:
        record = load_record(target)
    except RecordError:  # there is none, or none that anybody could use
        return
    if record.status != "finished":
        return
    whole = record.env.scenes_of_split
    now = whole if scenes is None else scenes
    lost = ""
    if len(seeds) < len(record.seeds) or now < (scenes_of_split or whole):
        before = f"seeds: {len(record.seeds)}, scenes: {whole}"
        lost = f"({before}), and this one would have less (seeds: {len(seeds)}, scenes: {now})"
    elif (record.division, record.seeds) == ("closed", list(SEEDS)) != (division, list(seeds)):
        given = ", ".join(map(str, seeds))
        lost = f"that can rank, and this one could not (division: {division}, seeds: {given})"
    if lost:
        raise RecordError(
            f"{target} is a finished record {lost}: choose another folder (-o, output=), or replace it (--force, "
            "replace=True)"
        )


def _record(
    plan: Plan,
    runs: Mapping[int, Sequence[SceneRun]],
    found: Evaluation,
    limits: Limits,
    division: Division,
    training_data: Sequence[str],
    commit: str,
) -> Record:
    lost, rollouts, submission, card = unanswered(runs), rollouts_of(runs), plan.submission, plan.card
    every = [rollout for results in rollouts.values() for rollout in results]
    return Record(
        submission=said_of(plan, commit),
        division=division,
        training_data=list(training_data),
        env=EnvPart(
            id=card.id,
            card_digest=card.digest,
            split=card.source.split,
            data_manifest=found.data_manifest,
            scenes=len(plan.scenes),
            scenes_of_split=plan.scenes_of_split,
            observe=submission.compare.observe,
            truth_complete=found.truth_complete,
            keywords=plan.stated_keywords,
        ),
        seeds=list(runs),
        versions=library_versions(),
        limits=LimitsPart(**asdict(limits)),
        missed=lost,
        isolation=isolation(runs),
        samples=every[0].forecast.shape[1],
        hashes=hashes(runs),
        measured=MeasuredPart(
            hardware=_hardware(plan.options),
            latency=latency(every),
            ms_per_frame=found.ms_per_frame,
            peak_memory_mib=peak_memory(runs),
            made=today(),
        ),
        **judged(found, lost, len(every), plan.scenes_of_split, plan.keywords),
    )


def _hardware(options: RunOptions) -> HardwarePart:
    """The machine that ran the agents: this one, or a worker of the cluster."""
    return hardware() if options.workers.scheduler is None else parallel_map(hardware, [()], options.workers)[0]


def said_of(plan: Plan, commit: str = "") -> SubmissionPart:
    """What a record says of a submission: of its commit what is given, else what its manifest says.

    Raises SubmissionError for a text that is too long for a record, and for a commit that is none.
    """
    submission = plan.submission
    ends = submission.compare.gap_references
    said = {
        "name": submission.name,
        "authors": list(submission.authors),
        "description": submission.description,
        "source": submission.source,
        "commit": commit or submission.commit,
        "paper": submission.paper,
        "license": submission.license,
        "digest": plan.image.digest,
        "networks": dict(plan.image.weights),
        "parameters": submission.parameters,
        "ends": "own" if isinstance(ends, dict) else ends,
    }
    return validate(SubmissionPart, said, f"{submission.path.name}/{MANIFEST}", SubmissionError)


def judged(
    found: Evaluation, lost: MissedPart, runs: int, scenes_of_split: int, keywords: Mapping[str, Any]
) -> dict[str, Any]:
    """The parts of a record that follow from an evaluation, under today's scorer: its numbers and its status.

    Args:
        found: The evaluation.
        lost: What was unanswered in the runs.
        runs: Number of runs: scenes x seeds.
        scenes_of_split: Number of scenes that the split has.
        keywords: Settings of the env, with another split than the card's where there is one.
    """
    scenes, split = len(found.per_scene), keywords.get("split")
    status, reason = status_of(scenes, scenes_of_split, lost.crashed_scenes, runs, lost.reasons, split)
    return {
        "scorer": ScorerPart(definitions=DEFINITIONS, source_digest=scorer_digest()),
        "reference": found.reference,
        "status": status,
        "status_reason": reason,
        "hypotheses": found.hypotheses,
        "rows": found.rows,
        "silence": found.silence,
        "details": found.details,
        "per_scene": found.per_scene,
    }
