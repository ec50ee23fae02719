"""Make a record: run a submission behind the gateway, score it, store its rollouts."""

from itertools import chain
from pathlib import Path
from typing import Any, cast

from ...agent import MANIFEST, Submission, load_submission
from ...cards import Card, load_card
from ...core import (
    DataError,
    MtpBenchError,
    RecordError,
    SubmissionError,
    describe_write_error,
    parallel_map,
    require_file,
    require_folder,
    require_part,
    validate,
    whole_file,
    whole_folder,
)
from ...running import (
    DEFAULTS,
    RunOptions,
    library_versions,
    reference_for,
    require_run_folder,
    save_run,
)
from ...scoring import DEFINITIONS
from ..gateway.limits import Limits
from . import running
from .canonical import digest_of, today
from .consistency import checked_text
from .eligibility import SEEDS, why_scored_otherwise
from .evaluation import Evaluation
from .parts import count_parts, open_parts, require_new
from .record import EnvPart, MeasuredPart, Observed, Record, SubmissionPart
from .running import Plan, Runs
from .storage import (
    PART_SUFFIX,
    ROLLOUTS_SUFFIX,
    record_text,
    seed_folder,
    usable_record,
)

RECORDS = Path("leaderboard", "records")  # below the working folder: the checkout


def submit(
    path: str | Path,
    env_id: str,
    options: RunOptions = DEFAULTS,
    output: str | Path | None = None,
    commit: str = "",
    resume: bool = False,
    replace: bool = False,
) -> Record:
    """Run a submission on an env, and write its record to ``output``/<env id>.json.

    Args:
        path: Folder of the submission, or name of a baseline.
        env_id: Id of the env or path of its card.
        options: Data, seeds, workers and progress. Some of the scenes make a partial
            record, which is never ranked. With a Dask cluster the record names the
            hardware of one worker.
        output: Folder; None: leaderboard/records/<name of the submission>.
        commit: Hex, the commit that holds the folder; empty: that of the manifest,
            which cannot name its own commit.
        resume: Continue with the scenes that an interrupted submit of this record
            finished, and keep a finished record of the same plan. Else finished scenes
            are refused.
        replace: Replace a finished record also by one of other seeds or scenes that
            cannot rank.

    Finished scenes are stored at once, record and rollouts together at the end: until
    then those of an earlier submit remain. Local frames are turned and shifted at
    random, so that coordinates do not tell the scene. An agent's actions are never an
    error: without a finished scene the status is "crashed". Raises MtpBenchError for
    mistakes that users can correct, before anything runs if the output cannot be
    written or a finished record would be lost.
    """
    submission = load_submission(path)
    plan = running.plan_run(submission, env_id, options)
    record_file = record_path(submission, load_card(env_id), output)
    require_target(record_file, submission, options, resume, replace)
    planned_content = plan_content(plan, commit)
    _require_recordable(plan, planned_content)
    if resume and (record := finished_record(record_file, planned_content)) is not None:
        return record
    is_drive = plan.card.drive is not None
    with open_parts(record_file, planned_content, resume) as parts:
        reference = reference_for(plan.card, plan.scenes, options)
        passes = len(options.seeds)
        if not is_drive:
            passes += 1  # then the scenes are scored
        options.progress.started(passes * len(plan.scenes))
        runs = {seed: running.run_seed(plan, seed, parts) for seed in options.seeds}
        evaluation = running.evaluate_plan(plan, runs, reference, with_progress=True)
        if not is_drive:  # the data of a drive reacts to the agent
            _require_one_data(plan, runs, evaluation, record_file)
        return _save(
            record_file, plan, runs, _record(plan, runs, evaluation, planned_content)
        )


def plan_content(plan: Plan, commit: str = "") -> dict[str, Any]:
    """Return all that is decided before the runs of a record, as JSON.

    A resumed command must have an equal plan.
    """
    return {
        "submission": plan.image.digest,
        "commit": commit,
        "env": plan.card.id,
        "card": plan.card.digest,
        "scenes": list(plan.scenes),
        "seeds": list(plan.options.seeds),
        "observe": plan.submission.compare.observe,
        "keywords": plan.keywords,
        "limits": Limits().model_dump(),
        "training_data": declared_data(plan.submission, plan.card.id),
        "definitions": DEFINITIONS,
        "versions": library_versions(),
    }


def finished_record(
    record_file: Path, planned_content: dict[str, Any], needs_rollouts: bool = True
) -> Record | None:
    """Return the record of a plan if it is complete.

    Otherwise return None. ``planned_content``: the plan, as `plan_content` gives it.
    ``needs_rollouts``: they must be stored beside it.
    """
    if count_parts(record_file) or (
        needs_rollouts and not record_file.with_suffix(ROLLOUTS_SUFFIX).is_dir()
    ):
        return None
    record = usable_record(record_file)
    if record is None or not is_of_plan(record, planned_content):
        return None
    return record


def is_of_plan(record: Record, planned_content: dict[str, Any]) -> bool:
    """Return True if a record was made by the plan ``planned_content``.

    Definitions are today's or earlier equal ones.
    """
    if not why_scored_otherwise(record):
        planned_content = planned_content | {"definitions": record.scorer.definitions}
    return record.plan == digest_of(planned_content)


def declared_data(submission: Submission, env_id: str) -> list[str]:
    """Return the training data that the record of a submission declares."""
    training_data = list(submission.training_data)
    if note := submission.note_on(env_id):
        training_data.append(note)
    return training_data


def record_path(submission: Submission, card: Card, output: str | Path | None) -> Path:
    """Return the path of the record of a submission on the env of ``card``."""
    if output is None:
        output = RECORDS / submission.name
    return Path(output) / f"{card.id}.json"


def submission_part(plan: Plan, commit: str = "") -> SubmissionPart:
    """Return the submission in a record.

    An empty ``commit`` is the manifest's. Raises SubmissionError for a text that is too
    long for a record, and for a malformed commit.
    """
    submission = plan.submission
    references = submission.compare.gap_references
    copied = ("name", "description", "source", "paper", "license", "parameters")
    content = {name: getattr(submission, name) for name in copied} | {
        "authors": list(submission.authors),
        "commit": commit or submission.commit,
        "digest": plan.image.digest,
        "networks": dict(plan.image.weights),
        "hypotheses": plan.setting.hypotheses,
        "gap_references": "own" if isinstance(references, dict) else references,
    }
    where = f"{submission.path.name}/{MANIFEST}"
    return validate(SubmissionPart, content, where, SubmissionError)


def require_target(
    record_file: Path,
    submission: Submission,
    options: RunOptions,
    resume: bool,
    replace: bool,
) -> None:
    """Raise MtpBenchError if a record cannot be written, or stored work would be lost.

    Lost would be: scenes of an interrupted submit, unless ``resume``; and unless
    ``replace``, a finished record whose place is taken by one that cannot rank and is
    of other seeds or scenes.
    """
    if record_file.resolve().is_relative_to(submission.path):
        raise SubmissionError(
            f"cannot write {record_file}: it is inside the submission "
            f"{submission.path}, "
            "name another folder"
        )
    require_folder(record_file)
    if record_file.parent.is_dir():
        require_file(record_file)
    rollouts = record_file.with_suffix(ROLLOUTS_SUFFIX)
    if rollouts.exists():
        for folder in rollouts.iterdir():
            require_run_folder(folder)
    if not replace:
        _require_kept(record_file, options)
    if not resume:
        require_new(record_file)


def _require_kept(record_file: Path, options: RunOptions) -> None:
    """Raise RecordError if a finished record would be lost.

    Another run of all its scenes may replace it, with its seeds or those that rank.
    """
    record = usable_record(record_file)
    if record is None or record.status != "finished":
        return
    count = record.env.scenes_of_split
    scenes = "all"
    if options.scenes is not None and options.scenes < count:
        scenes = str(options.scenes)
    elif list(options.seeds) in (list(SEEDS), record.seeds):
        return
    stored_seeds = ", ".join(map(str, record.seeds))
    seeds = ", ".join(map(str, options.seeds))
    raise RecordError(
        f"{record_file}: would overwrite a finished record (seeds {stored_seeds}, "
        f"all {count} "
        f"scenes) with another (seeds {seeds}, {scenes} scenes): choose another folder "
        "(-o, output=), or replace it (--force, replace=True)"
    )


def _save(record_file: Path, plan: Plan, runs: Runs, record: Record) -> Record:
    """Replace an earlier record and its rollouts.

    All that can fail comes before the first is replaced.
    """
    record, text = record_text(record, record_file)
    checked_text(text, record_file)
    try:
        with whole_file(record_file) as file:
            file.write_text(text, encoding="utf-8")
            with whole_folder(record_file.with_suffix(ROLLOUTS_SUFFIX)) as folder:
                for seed, rollouts in running.rollouts_of(runs).items():
                    info = running.info_of(plan, seed)
                    save_run(seed_folder(folder, seed), info, rollouts)
    except OSError as error:
        raise MtpBenchError(
            f"cannot write {record_file}: {describe_write_error(error)}"
        ) from None
    return record


def _require_one_data(
    plan: Plan, runs: Runs, evaluation: Evaluation, record_file: Path
) -> None:
    """Raise DataError if the data of scenes changed after they were run."""
    for seed_runs in runs.values():
        for name, run, digest in zip(
            plan.scenes, seed_runs, evaluation.scene_digests, strict=True
        ):
            if run.scene_digest not in ("", digest):  # empty: not known
                raise DataError(
                    f"{name}: its data changed after {plan.submission.name} was run on "
                    "it, expected the same data in all scenes: delete "
                    f"{record_file.with_suffix(PART_SUFFIX)} and submit again"
                )


def _require_recordable(plan: Plan, planned: dict[str, Any]) -> None:
    """Raise RecordError for a long text or many seeds, which no record holds."""
    env_card = plan.card
    content = {
        "submission": submission_part(plan, planned["commit"]).model_dump(mode="json"),
        "training_data": planned["training_data"],
        "env": {
            "id": env_card.id,
            "split": env_card.source.split,
            "keywords": plan.keywords,
        },
        "seeds": list(plan.options.seeds),
        "targets": {"scenes": list(plan.scenes)},
    }
    require_part(
        Record,
        content,
        f"a record of {plan.submission.name} on {env_card.id}",
        RecordError,
    )


def _record(
    plan: Plan, runs: Runs, evaluation: Evaluation, planned_content: dict[str, Any]
) -> Record:
    env_card = plan.card
    rollouts = list(chain.from_iterable(running.rollouts_of(runs).values()))
    scene_runs = chain.from_iterable(runs.values())
    peak_memory = max(run.peak_memory for run in scene_runs)
    # with a scheduler: of a worker
    (hardware,) = parallel_map(running.hardware, [()], plan.options.workers)
    return Record(
        submission=submission_part(plan, planned_content["commit"]),
        training_data=planned_content["training_data"],
        env=EnvPart(
            id=env_card.id,
            card_digest=env_card.digest,
            split=env_card.source.split,
            data_manifest=evaluation.data_manifest,
            scenes_of_split=plan.scenes_of_split,
            observe=cast("Observed", plan.submission.compare.observe),
            truth_complete=evaluation.truth_complete,
            keywords=plan.keywords,
        ),
        seeds=list(runs),
        versions=planned_content["versions"],
        limits=Limits(),
        missed=running.unanswered(runs),
        isolation=running.isolation(runs),
        hashes=running.hashes(runs),
        measured=MeasuredPart(
            hardware=hardware,
            latency=running.latency(rollouts),
            ms_per_frame=evaluation.ms_per_frame,
            peak_memory_mib=peak_memory / 2**20,
            made=today(),
        ),
        plan=digest_of(planned_content),
        **evaluation.record_fields,
    )
