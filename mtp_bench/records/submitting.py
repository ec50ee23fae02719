"""Make a record: run a submission behind the gateway, score it, store what it said beside the record."""

from __future__ import annotations

import datetime
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from ..cards import Card, load_card
from ..errors import MtpBenchError
from ..files import require_file, require_folder
from ..gateway import Limits, SceneRun
from ..parallel import Workers, parallel_map
from ..running.reference import frozen_reference
from ..running.rollout_files import require_run_folder, save_run
from ..running.run import library_versions
from ..scoring import DEFINITIONS
from ..submission.loader import Submission, load_submission
from ..types import Rollout
from .evaluation import Evaluation, Progress, evaluate, status_of
from .provenance import hardware, scorer_digest
from .record import EnvPart, HardwarePart, Record, ScorerPart, SubmissionPart
from .running import Plan, info_of, isolation, latency, missed, peak_memory, plan_run, rollout_digests, run_seed, seals
from .storage import ROLLOUTS, rollouts_folder, save_record

RECORDS = Path("leaderboard", "records")  # relative to the working folder: the checkout


def submit(
    path: str | Path,
    env_id: str,
    data: str | None = None,
    seeds: int = 3,
    scenes: int | None = None,
    workers: int = 1,
    output: str | Path | None = None,
    division: Literal["closed", "open"] = "closed",
    training_data: Sequence[str] = (),
    started: Callable[[int], object] | None = None,
    progress: Progress | None = None,
    limits: Limits | None = None,
    scheduler: str | None = None,
    split: str | None = None,
) -> Record:
    """Run the submission at ``path`` on an env behind the gateway, and write its record to ``output``/<env id>.json.

    ``output``: None stands for leaderboard/records/<name of the submission>. On the first ``scenes`` scenes (None:
    all); a part of them makes a partial record, which is never ranked, as does another ``split`` than the env's. In
    every run the local frames are turned and shifted at random: what an agent knows of the scenes by their coordinates
    is of no use. ``started`` is told the number of runs and scenes to score, ``progress`` the scene of each that is
    done. With the address of a Dask ``scheduler`` its workers run the agent, and the record names the hardware of one
    of them.

    What an agent does is never an error: a submission of which no scene was finished has the status "crashed". Raises
    MtpBenchError for whatever the user can mend, an output that cannot be written before anything runs.
    """
    limits = limits or Limits()
    _check_counts(seeds, scenes)
    submission = load_submission(path)
    plan = plan_run(submission, env_id, data, scenes, split)
    target = record_path(submission, load_card(env_id), output, split)
    require_writable(target)
    frozen_reference(plan.card)  # a broken file shows before anything runs
    if started is not None:
        started((seeds + 1) * len(plan.scenes))
    runs = {seed: run_seed(plan, seed, workers, progress, limits, scheduler) for seed in range(seeds)}
    rollouts = {seed: [run.rollout for run in results] for seed, results in runs.items()}
    found = evaluate(submission.name, plan.card, data, rollouts, plan.hypotheses, plan.ideal, workers, progress)
    record = _record(plan, runs, rollouts, found, limits).model_copy(
        update={
            "division": division,
            "training_data": [*plan.submission.training_data, *training_data],
            "hardware": _hardware(scheduler),
        }
    )
    _store(target, plan, rollouts)
    return save_record(record, target)


def _hardware(scheduler: str | None) -> HardwarePart:
    """Of this machine, or of a worker of the scheduler."""
    return hardware() if scheduler is None else parallel_map(hardware, [()], Workers(1, "dask", scheduler))[0]


def record_path(submission: Submission, card: Card, output: str | Path | None, split: str | None = None) -> Path:
    """Where the record of a submission on the env of ``card`` goes; on another ``split`` beside the one on its own."""
    folder = RECORDS / submission.name if output is None else Path(output)
    other = "" if split in (None, card.source.split) else f"-{split}"
    return folder / f"{card.id}{other}.json"


def _check_counts(seeds: int, scenes: int | None) -> None:
    for name, value in (("seeds", seeds), ("scenes", scenes)):
        if value is not None and value < 1:
            raise MtpBenchError(f"{name} is {value}, expected at least 1")


def require_writable(target: Path) -> None:
    """Refuse a record before the work: a file in the place of a folder, no permission, or no rollouts."""
    require_folder(target)
    if target.parent.is_dir():
        require_file(target)
    if target.with_suffix(ROLLOUTS).exists():
        for folder in target.with_suffix(ROLLOUTS).iterdir():
            require_run_folder(folder)


def _store(target: Path, plan: Plan, rollouts: Mapping[int, Sequence[Rollout]]) -> None:
    """Write the rollouts of all seeds in the place of those of an earlier record."""
    shutil.rmtree(target.with_suffix(ROLLOUTS), ignore_errors=True)
    for seed, results in rollouts.items():
        save_run(rollouts_folder(target, seed), info_of(plan, seed), results)


def _record(
    plan: Plan,
    runs: Mapping[int, Sequence[SceneRun]],
    rollouts: Mapping[int, Sequence[Rollout]],
    found: Evaluation,
    limits: Limits,
) -> Record:
    lost = missed(runs)
    every = [rollout for results in rollouts.values() for rollout in results]
    status, reason = status_of(
        len(plan.scenes),
        plan.scenes_of_split,
        lost.crashed_scenes,
        len(every),
        lost.reasons,
        plan.keywords.get("split"),
    )
    return Record(
        submission=submission_part(plan.submission),
        division="closed",
        training_data=[],
        env=_env_part(plan, found),
        scorer=ScorerPart(definitions=DEFINITIONS, source_digest=scorer_digest()),
        reference=found.reference,
        seeds=list(runs),
        status=status,
        status_reason=reason,
        versions=library_versions(),
        hardware=hardware(),
        latency=latency(every, 1e3 * limits.frame),
        peak_memory_mib=peak_memory(runs),
        missed=lost,
        isolation=isolation(runs),
        hypotheses=found.hypotheses,
        samples=every[0].forecast.shape[1],
        rows=found.rows,
        details=found.details,
        per_scene=found.per_scene,
        seals=seals(runs),
        rollout_digests=rollout_digests(rollouts),
        made=datetime.datetime.now(datetime.UTC).date().isoformat(),
    )


def submission_part(submission: Submission) -> SubmissionPart:
    """What a record says of a submission."""
    return SubmissionPart(
        name=submission.name,
        authors=list(submission.authors),
        description=submission.description,
        digest=submission.digest,
        parameters=submission.parameters,
    )


def _env_part(plan: Plan, found: Evaluation) -> EnvPart:
    card = plan.card
    return EnvPart(
        id=card.id,
        card_digest=card.digest,
        split=card.source.split,
        data_manifest=found.data_manifest,
        scenes=len(plan.scenes),
        scenes_of_split=plan.scenes_of_split,
        observe=plan.submission.compare.observe,
        truth_complete=found.truth_complete,
        keywords=plan.keywords,
    )
