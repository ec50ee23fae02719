"""Runs on disk: what `mtp-bench run` stores and `mtp-bench score` reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import RolloutError
from ..files import require_folder
from ..scoring import AgentScores, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..types import Rollout, Scene
from .opened import open_run
from .options import DEFAULTS, RunOptions
from .reading import total_skipped
from .reference import reference_for
from .rollout_files import require_run_folder, require_storable, save_run
from .run import jobs_of, run_info, run_jobs
from .settings import setting_of, submission_of


@dataclass(frozen=True)
class StoredRun:
    """What `run` did."""

    scenes: int
    skipped: dict[str, int]  # rows of the data that could not be used, by reason
    rejected: int  # rows of the agent's answers that broke the contract


@dataclass(frozen=True)
class StoredScore:
    """Report of a stored run."""

    report: Report
    origin: str  # where its subsets come from
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def run(
    agent: str | Path, env_id: str | Card, folder: str | Path, options: RunOptions = DEFAULTS, replace: bool = False
) -> StoredRun:
    """Run a submission on the scenes of an env and store its rollouts.

    Args:
        agent: Folder of the submission, or name of a baseline.
        env_id: Id of the env, path of its card, or a card.
        folder: Where the rollouts go.
        options: Data, scenes, changes of the card, workers and progress; of the seeds, the first.
        replace: Whether an earlier run in ``folder`` gives way, once this one is complete.

    Raises MtpBenchError for whatever the user can mend, and before anything runs where ``folder`` cannot be written or
    holds a run that is not to be replaced.
    """
    folder = Path(folder)
    require_free(folder, replace)
    submission, seed = submission_of(agent), options.seeds[0]
    options.require_tracks_used([submission])
    shown = options.shown_to(submission)
    env = MTPEnv(env_id, evaluation=True, **shown, **options.env_keywords)
    setting = setting_of(submission, env.card)
    keywords = {**setting.env_keywords(env.card), **shown, **options.changes}
    names = options.chosen(env.scene_names)
    jobs = jobs_of(submission, env_id, {"data": options.data, **keywords}, names, seed)
    info = run_info(env, setting, seed, keywords).model_copy(update={"card": env.card.stored()})
    require_storable(info, names)
    results: list[tuple[Rollout, dict[str, int]]] = run_jobs(jobs, options, _keep)
    save_run(folder, info, [rollout for rollout, _ in results])
    rejected = sum(int(rollout.invalid.sum()) for rollout, _ in results)
    return StoredRun(len(results), total_skipped(skipped for _, skipped in results), rejected)


def require_free(folder: Path, replace: bool) -> None:
    """Raise MtpBenchError where no run can be stored: no folder, no permission, or one that is not to be replaced."""
    require_run_folder(folder.absolute())
    if not replace and folder.exists() and any(folder.iterdir()):
        raise RolloutError(
            f"{folder} holds an earlier run: choose another folder, or replace it (--force, replace=True)"
        )
    require_folder(folder)


def _keep(scene: Scene, rollout: Rollout, card: Card) -> tuple[Rollout, dict[str, int]]:
    """The rollout of a scene, and what was skipped while reading it."""
    return rollout, scene.skipped


def score(folder: str | Path, options: RunOptions = DEFAULTS, env_id: str | Card | None = None) -> StoredScore:
    """Report of a stored run.

    Args:
        folder: Where `run` put it.
        options: Data and progress; all else is as the run says of itself.
        env_id: Id, path or card, where it is not the card that the run keeps.

    Raises RolloutError where the run was made for another version of the card, or says other things than its rollouts.
    """
    opened = open_run(Path(folder), options.data, env_id)
    info, card = opened.run.info, opened.card
    options.progress.started(len(opened.run.rollouts))
    scores: list[SceneScore] = []
    for rollout in opened.run.rollouts:
        scores.append(score_scene(opened.recorded(rollout.scene), rollout, card))
        options.progress.done(rollout.scene)
    agent = AgentScores(
        agent=info.agent,
        hypotheses=info.hypotheses or stated_hypotheses([scores]),
        samples=info.samples,
        budget="equal" if info.samples == card.task.samples else "free",
        seeds=(tuple(scores),),
        ideal=info.observe == "truth",
        stored_tracks=info.observe == "tracks",
    )
    reference = reference_for(card, [rollout.scene for rollout in opened.run.rollouts], options)
    report = summarise([agent], card, reference)
    if info.note:
        report.condition["trained"] = f"{info.note}: {info.agent}"
    return StoredScore(report, reference.origin, total_skipped(score.skipped for score in scores))
