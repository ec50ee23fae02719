"""Runs of a submission behind the gateway, one per seed, and what they say of it beside their answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..cards import Card, load_card
from ..env.environment import MTPEnv
from ..env.rollouts import digest
from ..gateway import Limits, SceneRun, run_isolated_scenes
from ..parallel import Workers
from ..running.compare import setting_of
from ..running.rollout_files import RunInfo
from ..running.run import run_info
from ..submission.loader import Submission
from ..types import Rollout
from .evaluation import Progress
from .record import IsolationPart, LatencyPart, MissedPart
from .storage import key_of


@dataclass(frozen=True, eq=False)
class Plan:
    """What is run: a submission on scenes of an env."""

    submission: Submission
    env: str | Card  # id, path of a card, or a card that is in no file
    card: Card
    data: str | None
    scenes: tuple[str, ...]
    scenes_of_split: int
    keywords: dict[str, Any]  # of the env, beyond card and data; as stored

    @property
    def ideal(self) -> bool:
        """Whether the agent is shown the truth."""
        return self.submission.compare.observe == "truth"

    @property
    def hypotheses(self) -> int | None:
        """As declared by the submission."""
        return setting_of(self.submission, self.card).hypotheses


def plan_run(
    submission: Submission, env_id: str, data: str | None, scenes: int | None = None, split: str | None = None
) -> Plan:
    """The first ``scenes`` scenes (None: all) of an env for a submission, with its own parameters and k samples.

    ``split``: another one than the card's. Raises MtpBenchError for an unknown env or split, missing data or a
    parameter that is wrong.
    """
    env = MTPEnv(env_id, data=data, observe=submission.compare.observe, evaluation=True, split=split)
    keywords = setting_of(submission, env.card).env_keywords(env.card)
    if env.card.source.split != load_card(env_id).source.split:
        keywords["split"] = env.card.source.split
    names = env.scene_names
    return Plan(submission, env_id, env.card, data, names[:scenes], len(names), keywords)


def run_seed(
    plan: Plan, seed: int, workers: int, progress: Progress | None, limits: Limits, scheduler: str | None = None
) -> list[SceneRun]:
    """Every scene of the plan under one seed, in the order of the plan; never raises for what an agent does."""
    keywords = {**plan.keywords, "data": plan.data, "observe": plan.submission.compare.observe}
    return run_isolated_scenes(
        plan.submission.path,
        cast("str", plan.env),  # for MTPEnv, which takes a card as well
        {**keywords, "rigid_motion": True},
        seed=seed,
        parameters=plan.submission.parameters,
        limits=limits,
        scenes=plan.scenes,
        workers=Workers(workers, "dask" if scheduler else "loky", scheduler),
        progress=progress,
    )


def info_of(plan: Plan, seed: int) -> RunInfo:
    """What a stored run of the plan says of itself; the data root is nobody's business."""
    submission = plan.submission
    env = MTPEnv(plan.env, data=plan.data, observe=submission.compare.observe, evaluation=True, **plan.keywords)
    keywords = {**{k: v for k, v in plan.keywords.items() if k != "samples"}, "rigid_motion": True}
    return run_info(env, submission.name, seed, submission.parameters, submission.digest, keywords)


def rollout_digests(runs: Mapping[int, Sequence[Rollout]]) -> dict[str, str]:
    """Digest of every rollout."""
    return {key_of(r.scene, seed): digest(r) for seed, rollouts in runs.items() for r in rollouts}


def seals(runs: Mapping[int, Sequence[SceneRun]]) -> dict[str, str]:
    """Hash chain over the answers of every scene and seed."""
    return {key_of(r.rollout.scene, seed): r.seal for seed, results in runs.items() for r in results}


def missed(runs: Mapping[int, Sequence[SceneRun]]) -> MissedPart:
    """Frames and scenes that are missing for another reason than silence."""
    every = [run for results in runs.values() for run in results]
    cut = {
        key_of(run.rollout.scene, seed): f"{run.status}: {run.reason}"
        for seed, results in runs.items()
        for run in results
        if run.status != "finished"
    }
    return MissedPart(
        late=sum(run.late for run in every),
        malformed=sum(run.malformed for run in every),
        crashed_scenes=len(cut),
        reasons=cut,
    )


def isolation(runs: Mapping[int, Sequence[SceneRun]]) -> IsolationPart:
    """What the agent was kept from in every run."""
    every = [run for results in runs.values() for run in results]
    return IsolationPart(
        network_cut=all(run.network_cut for run in every), files_hidden=all(run.files_hidden for run in every)
    )


def latency(rollouts: Sequence[Rollout], limit_ms: float) -> LatencyPart:
    """Percentiles over the frames of all rollouts but the first of each; frames without an answer are left out."""
    seconds = np.concatenate([np.zeros(0), *(rollout.seconds[1:] for rollout in rollouts)])
    seconds = seconds[np.isfinite(seconds) & (seconds > 0)]
    if not len(seconds):
        return LatencyPart(p50_ms=None, p95_ms=None, max_ms=None, limit_ms=limit_ms)
    p50, p95, most = (float(value) for value in np.percentile(1e3 * seconds, [50, 95, 100]))
    return LatencyPart(p50_ms=p50, p95_ms=p95, max_ms=most, limit_ms=limit_ms)


def peak_memory(runs: Mapping[int, Sequence[SceneRun]]) -> float:
    """MiB of the largest of the agent's processes."""
    return max((run.peak_memory for results in runs.values() for run in results), default=0) / 2**20
