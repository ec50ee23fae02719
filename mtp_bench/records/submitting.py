"""Make a record: run a submission behind the gateway, score it, and store its rollouts beside the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..cards import Card, load_card
from ..errors import DataError, MtpBenchError, RecordError, SubmissionError
from ..files import describe_write_error, require_file, require_folder, whole_file, whole_folder
from ..gateway import Limits, image_of
from ..parallel import parallel_map
from ..running.options import DEFAULTS, RunOptions
from ..running.reference import reference_for
from ..running.rollout_files import require_run_folder, save_run
from ..running.run import library_versions
from ..scoring import DEFINITIONS
from ..strict import require_part, validate
from ..submission.loader import Submission, load_submission
from ..submission.manifest import MANIFEST
from .canonical import digest_of, today
from .consistency import checked_text
from .eligibility import SEEDS
from .evaluation import Evaluation
from .parts import Start, open_parts
from .record import Division, EnvPart, LimitsPart, MeasuredPart, Record, SubmissionPart
from .running import (
    Plan,
    Runs,
    evaluate_plan,
    hardware,
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
from .storage import PARTS, ROLLOUTS, load_record, record_text, save_record, seed_folder

RECORDS = Path("leaderboard", "records")  # below the working folder: the checkout


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
        options: Data, seeds, workers and progress. Some of the scenes, or another split than the env's, make a partial
            record, which is never ranked. With a Dask cluster the record names the hardware of one worker.
        output: Folder; None: leaderboard/records/<name of the submission>.
        division: Division of the ranking.
        training_data: Training data beyond that of the manifest.
        commit: Hex, the commit that holds the folder; empty: that of the manifest, which cannot name its own commit. A
            finished record that is resumed gets another one without a run.
        limits: Limits of the agent; those of the closed division are fixed.
        start: Treatment of scenes that an interrupted submit of this record finished: "new" refuses them, "resume"
            continues with them (and keeps a finished record of the same plan), "fresh" discards them.
        replace: Replace a finished record also by one of fewer seeds or scenes, or one that cannot rank.

    Every finished scene is stored at once. Record and rollouts are written together, at the end: until then, and after
    any failure, those of an earlier submit remain. In every run the local frames are turned and shifted at random, so
    that scenes cannot be recognised by their coordinates. Actions of an agent are never an error: a submission of which
    no scene was finished has the status "crashed". Raises MtpBenchError for mistakes that the user can correct, before
    anything runs if the output cannot be written or a finished record would be lost.
    """
    submission = load_submission(path)
    plan = plan_run(submission, env_id, options)
    target = record_path(submission, load_card(env_id), output, options.split)
    require_writable(target, submission)
    if not replace:
        require_kept(target, options.seeds, len(plan.scenes), division, plan.scenes_of_split)
    _require_division(division, submission, limits)
    declared = declared_data(submission, plan.card.id, training_data)
    _require_recordable(plan, limits, division, declared, commit)
    content = plan_content(plan, limits, division, declared)
    if start == "resume" and (record := finished_record(target, content)) is not None:
        if commit in ("", record.submission.commit):
            return record
        return save_record(record.model_copy(update={"submission": submission_part(plan, commit)}), target)
    with open_parts(target, content, start) as parts:
        reference = reference_for(plan.card, plan.scenes, options)
        options.progress.started((len(options.seeds) + 1) * len(plan.scenes))
        runs = {seed: run_seed(plan, seed, limits, parts) for seed in options.seeds}
        _require_unchanged(plan)
        evaluation = evaluate_plan(plan, runs, reference, with_progress=True)
        _require_one_data(plan, runs, evaluation)
        return _save(target, plan, runs, _record(plan, runs, evaluation, content, commit))


def plan_content(plan: Plan, limits: Limits, division: str, training_data: Sequence[str]) -> dict[str, Any]:
    """All that is decided before the runs of a record, as JSON; a resumed command must have an equal plan."""
    return {
        "submission": plan.image.digest,
        "env": plan.card.id,
        "card": plan.card.digest,
        "scenes": list(plan.scenes),
        "seeds": list(plan.options.seeds),
        "observe": plan.submission.compare.observe,
        "keywords": plan.stated_keywords,
        "limits": asdict(limits),
        "division": division,
        "training_data": list(training_data),
        "definitions": DEFINITIONS,
        "versions": library_versions(),
    }


def finished_record(target: Path, content: dict[str, Any], rollouts: bool = True) -> Record | None:
    """The record at ``target`` if it is complete and of the plan ``content``, else None.

    ``rollouts``: they must be stored beside it.
    """
    if target.with_suffix(PARTS).exists() or (rollouts and not target.with_suffix(ROLLOUTS).is_dir()):
        return None
    try:
        record = load_record(target)
    except RecordError:
        return None
    return record if record.plan == digest_of(content) else None


def declared_data(submission: Submission, env_id: str, more: Sequence[str] = ()) -> list[str]:
    """Training data that the record of a submission on an env declares: that of its manifest, and ``more``."""
    note = submission.note_on(env_id)
    return [*submission.training_data, *more, *([note] if note else [])]


def record_path(submission: Submission, card: Card, output: str | Path | None, split: str | None = None) -> Path:
    """Path of the record of a submission on the env of ``card``; that on another ``split`` lies beside it."""
    folder = RECORDS / submission.name if output is None else Path(output)
    other = "" if split in (None, card.source.split) else f"-{split}"
    return folder / f"{card.id}{other}.json"


def submission_part(plan: Plan, commit: str = "") -> SubmissionPart:
    """The submission in a record: its commit is the given one, else that of the manifest.

    Raises SubmissionError for a text that is too long for a record, and for a malformed commit.
    """
    submission = plan.submission
    ends = submission.compare.gap_references
    content = {
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
        "hypotheses": plan.setting.hypotheses,
        "ends": "own" if isinstance(ends, dict) else ends,
    }
    return validate(SubmissionPart, content, f"{submission.path.name}/{MANIFEST}", SubmissionError)


def require_writable(target: Path, submission: Submission) -> None:
    """Refuse a target before the work: inside the submission, not writable, or beside a folder of other files."""
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
    """Raise RecordError if a finished record at ``target`` would be replaced by a smaller one or one that cannot rank.

    ``scenes``: None for all. ``scenes_of_split``: of the split; None: as many as in the record.
    """
    try:
        record = load_record(target)
    except RecordError:  # missing, or unusable
        return
    if record.status != "finished":
        return
    whole = record.env.scenes_of_split
    now = whole if scenes is None else scenes
    lost = ""
    if len(seeds) < len(record.seeds) or now < (scenes_of_split or whole):
        lost = f"(seeds: {len(record.seeds)}, scenes: {whole}) with a smaller one (seeds: {len(seeds)}, scenes: {now})"
    elif (record.division, record.seeds) == ("closed", list(SEEDS)) != (division, list(seeds)):
        given = ", ".join(map(str, seeds))
        lost = f"that can rank with one that cannot (division {division}, seeds {given})"
    if lost:
        raise RecordError(
            f"{target}: would overwrite a finished record {lost}: choose another folder (-o, output=), or replace it "
            "(--force, replace=True)"
        )


def _save(target: Path, plan: Plan, runs: Runs, record: Record) -> Record:
    """Replace an earlier record and its rollouts; all that can fail comes before the first is replaced."""
    record, text = record_text(record, target)
    checked_text(text, str(target))
    try:
        with whole_file(target) as file:
            file.write_text(text, encoding="utf-8")
            with whole_folder(target.with_suffix(ROLLOUTS)) as folder:
                for seed, rollouts in rollouts_of(runs).items():
                    save_run(seed_folder(folder, seed), info_of(plan, seed), rollouts)
    except OSError as error:
        raise MtpBenchError(f"cannot write {target}: {describe_write_error(error)}") from None
    return record


def _require_unchanged(plan: Plan) -> None:
    """Raise SubmissionError if the files of the submission were changed while it was run."""
    now = image_of(load_submission(plan.submission.path), plan.card.id, plan.card.weights_of)
    if now.digest != plan.image.digest:
        raise SubmissionError(
            f"{plan.submission.path}: its files were changed while it was run, expected one submission in all scenes: "
            "submit again with --fresh"
        )


def _require_one_data(plan: Plan, runs: Runs, evaluation: Evaluation) -> None:
    """Raise DataError if the data of scenes changed after an interrupted command ran them."""
    for results in runs.values():
        for name, run, digest in zip(plan.scenes, results, evaluation.scene_digests, strict=True):
            if run.scene_digest not in ("", digest):
                raise DataError(
                    f"{name}: its data changed after {plan.submission.name} was run on it, expected the same data in "
                    "all scenes: submit again with --fresh"
                )


def _require_division(division: str, submission: Submission, limits: Limits) -> None:
    """Raise MtpBenchError for what the closed division does not allow: stored tracks, which may know the future."""
    if division != "closed":
        return
    if submission.compare.observe == "tracks":
        raise MtpBenchError(
            f"{submission.name} observes stored tracks, which may have seen the future: choose the open division; "
            "there it is shown, not ranked"
        )
    if limits != Limits():
        changed = [name for name, value in asdict(limits).items() if value != getattr(Limits(), name)]
        raise MtpBenchError(
            f"the limits of the closed division are fixed, got another {', '.join(changed)}: choose the open division"
        )


def _require_recordable(plan: Plan, limits: Limits, division: str, training_data: Sequence[str], commit: str) -> None:
    """Refuse before the work what a record cannot hold: a text that is too long, too many seeds."""
    card = plan.card
    content = {
        "submission": submission_part(plan, commit).model_dump(mode="json"),
        "division": division,
        "training_data": list(training_data),
        "env": {"id": card.id, "split": card.source.split, "keywords": plan.stated_keywords},
        "seeds": list(plan.options.seeds),
        "limits": asdict(limits),
        "per_scene": [{"scene": name} for name in plan.scenes],
    }
    require_part(Record, content, f"a record of {plan.submission.name} on {card.id}", RecordError)


def _record(plan: Plan, runs: Runs, evaluation: Evaluation, content: dict[str, Any], commit: str) -> Record:
    missed, card = unanswered(runs), plan.card
    every = [rollout for results in rollouts_of(runs).values() for rollout in results]
    scheduler = plan.options.workers.scheduler
    return Record(
        submission=submission_part(plan, commit),
        division=content["division"],
        training_data=content["training_data"],
        env=EnvPart(
            id=card.id,
            card_digest=card.digest,
            split=card.source.split,
            data_manifest=evaluation.data_manifest,
            scenes=len(plan.scenes),
            scenes_of_split=plan.scenes_of_split,
            observe=plan.submission.compare.observe,
            truth_complete=evaluation.truth_complete,
            keywords=plan.stated_keywords,
        ),
        seeds=list(runs),
        versions=content["versions"],
        limits=LimitsPart(**content["limits"]),
        missed=missed,
        isolation=isolation(runs),
        samples=every[0].forecast.shape[1],
        hashes=hashes(runs),
        measured=MeasuredPart(
            hardware=hardware() if scheduler is None else parallel_map(hardware, [()], plan.options.workers)[0],
            latency=latency(every),
            ms_per_frame=evaluation.ms_per_frame,
            peak_memory_mib=peak_memory(runs),
            made=today(),
        ),
        plan=digest_of(content),
        **evaluation.record_parts(missed, len(every), plan.scenes_of_split, plan.keywords),
    )
