"""Runs on disk: what `mtp-bench run` stores and `mtp-bench score` reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import RolloutError
from ..files import require_folder
from ..parallel import Workers
from ..scoring import AgentScores, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..submission.loader import load_submission
from ..types import Rollout, Scene
from .compare import setting_of
from .jobs import jobs_of
from .opened import open_run
from .reading import total_skipped
from .reference import Reference, frozen_reference
from .rollout_files import Run, require_run_folder, save_run
from .run import run_info, run_jobs

Started = Callable[[int], object]
Done = Callable[[str], object]


@dataclass(frozen=True)
class StoredRun:
    """What `run_and_store` did."""

    scenes: int
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


@dataclass(frozen=True)
class StoredScore:
    """Report of a stored run."""

    report: Report
    origin: str  # where its subsets come from
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def run_and_store(
    agent: str,
    env_id: str,
    folder: Path,
    data: str | None = None,
    scenes: int | None = None,
    workers: int = 1,
    seed: int = 0,
    started: Started | None = None,
    progress: Done | None = None,
    changes: dict[str, Any] | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
) -> StoredRun:
    """Run a submission on the first ``scenes`` scenes (None: all) of an env and store its rollouts in ``folder``.

    ``changes``: ``split``, ``detector`` or ``detection_file`` of the env where it is not the card's. ``backend`` and
    ``scheduler`` as in `run_jobs`.

    Raises MtpBenchError for whatever the user can mend, a folder that cannot be written before anything runs.
    """
    require_run_folder(folder.absolute())
    require_folder(folder)
    submission = load_submission(agent)
    changes = changes or {}
    env = MTPEnv(env_id, data=data, observe=submission.compare.observe, evaluation=True, **changes)
    names = env.scene_names[:scenes]
    setting = setting_of(submission, env.card)
    keywords = {**setting.env_keywords(env.card), **changes}
    if started is not None:
        started(len(names))
    jobs = jobs_of(submission, env_id, {"data": data, **keywords}, names, seed)
    results: list[tuple[Rollout, dict[str, int]]] = run_jobs(
        jobs, Workers(workers, backend, scheduler), _keep, progress
    )
    keywords.pop("samples")  # the card's, and a field of its own
    info = run_info(env, submission.name, seed, submission.parameters, submission.digest, keywords)
    save_run(folder, info, [rollout for rollout, _ in results])
    return StoredRun(len(results), total_skipped(skipped for _, skipped in results))


def _keep(scene: Scene, rollout: Rollout, card: Card) -> tuple[Rollout, dict[str, int]]:
    """The rollout of a scene, and what was skipped while reading it."""
    return rollout, scene.skipped


def score_stored(
    folder: Path,
    data: str | None = None,
    started: Started | None = None,
    progress: Done | None = None,
    env_id: str | None = None,
) -> StoredScore:
    """Report of a stored run; ``env_id`` names the card of a run whose env does not ship with the library.

    Raises RolloutError where the run was made for another version of the card, or says other things than its rollouts.
    """
    opened = open_run(folder, data, env_id)
    run, card = opened.run, opened.card
    if started is not None:
        started(len(run.rollouts))
    scores: list[SceneScore] = []
    for rollout in run.rollouts:
        scores.append(score_scene(opened.scene(rollout.scene), rollout, card))
        if progress is not None:
            progress(rollout.scene)
    agent = AgentScores(
        agent=run.info.agent,
        hypotheses=_hypotheses(folder, run) or stated_hypotheses([scores]),
        samples=run.info.samples,
        budget="equal" if run.info.samples == card.task.samples else "free",
        seeds=(tuple(scores),),
        ideal=run.info.observe == "truth",
    )
    reference = frozen_reference(card)
    report = summarise([agent], card, reference.subsets if reference else None)
    return StoredScore(report, _origin(reference), total_skipped(score.skipped for score in scores))


def _hypotheses(folder: Path, run: Run) -> int:
    value = run.info.parameters.get("hypotheses", 0)
    if isinstance(value, bool) or not isinstance(value, int):
        raise RolloutError(f"{folder}: parameter 'hypotheses' is {value!r}, expected a whole number")
    return value


def _origin(reference: Reference | None) -> str:
    if reference is None:
        return "no frozen subsets for this env and split: only 'all' has targets; `mtp-bench compare` makes the others"
    return reference.origin
