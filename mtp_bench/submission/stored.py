"""Runs on disk: what `mtp-bench run` stores and `mtp-bench score` reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..cards import load_card
from ..env import MTPEnv
from ..errors import RolloutError, UnknownNameError
from ..rollouts import load_run, save_run
from ..runner import run_info, run_jobs
from ..scoring import AgentScores, Report, score_scene, summarise
from ..sources import open_source
from .jobs import jobs_of
from .loader import load_submission
from .reference import Reference, frozen_reference

Started = Callable[[int], object]
Done = Callable[[str], object]


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
) -> int:
    """Run a submission on the first ``scenes`` scenes (None: all) of an env; number of scenes stored in ``folder``."""
    submission = load_submission(agent)
    env = MTPEnv(env_id, data=data, observe=submission.compare.observe, evaluation=True)
    names = env.scene_names[:scenes]
    if started is not None:
        started(len(names))
    jobs = jobs_of(submission, env_id, {"data": data}, names, seed)
    rollouts = run_jobs(jobs, workers, None, progress)
    save_run(folder, run_info(env, submission.name, seed, submission.parameters, submission.digest), rollouts)
    return len(rollouts)


def score_stored(
    folder: Path, data: str | None = None, started: Started | None = None, progress: Done | None = None
) -> tuple[Report, str, str]:
    """Report of a stored run, where its subsets come from, and the name of the dataset.

    Raises RolloutError where the run was made for another version of the card.
    """
    run = load_run(folder)
    card = load_card(run.info.env_id)
    if card.digest != run.info.card_digest:
        raise RolloutError(
            f"{folder}: made for {card.id} with card digest {run.info.card_digest}, the card now has {card.digest}; "
            "run the agent again"
        )
    source = open_source(card, data)
    if started is not None:
        started(len(run.rollouts))
    scores = []
    for rollout in run.rollouts:
        if rollout.scene not in source.names:
            raise UnknownNameError(f"scene of {folder}", rollout.scene, source.names)
        scores.append(score_scene(source.load(rollout.scene), rollout, card))
        if progress is not None:
            progress(rollout.scene)
    agent = AgentScores(
        agent=run.info.agent,
        hypotheses=int(run.info.parameters.get("hypotheses", 1)),
        samples=run.info.samples,
        budget="equal" if run.info.samples <= card.task.samples else "free",
        seeds=(tuple(scores),),
        ideal=run.info.observe == "truth",
    )
    reference = frozen_reference(card)
    report = summarise([agent], card, reference.subsets if reference else None)
    return report, _origin(reference), card.source.name


def _origin(reference: Reference | None) -> str:
    if reference is None:
        return "no frozen subsets for this env and split: only 'all' has targets; `mtp-bench compare` makes the others"
    return reference.origin
