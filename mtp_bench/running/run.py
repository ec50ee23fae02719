"""Runs agents through scenes: one after the other, or over the cores of a machine."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._version import __version__
from ..agent import Agent
from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError, SubmissionError, UnknownNameError
from ..parallel import ALONE, Workers, parallel_map
from ..scoring.definitions import DEFINITIONS
from ..types import Rollout, Scene, Task
from .rollout_files import RunInfo

MakeAgent = Callable[[Task], Agent]
Finish = Callable[[Scene, Rollout, Card], Any]
Progress = Callable[[str], object]


def run_scene(agent: Agent, env: MTPEnv, scene_name: str, seed: int, name: str | None = None) -> Rollout:
    """Rollout of ``agent`` on one scene of ``env``, with the seconds that ``act`` took per frame.

    The agent's own seed depends on ``seed`` alone, so that it does not give the scene away. Raises SubmissionError,
    naming the agent (``name``, else its class), scene and frame, if the agent raises; answers that break the contract
    are counted in the rollout instead.
    """
    name = name or type(agent).__name__
    observation, _ = env.reset(seed=derived_seed(seed, scene_name, "env"), options={"scene": scene_name})
    try:
        agent.reset(agent_task(env, seed))
    except (Exception, SystemExit) as error:
        raise _failure(name, scene_name, "reset", error) from error
    seconds: list[float] = []
    truncated = False
    while not truncated:
        try:
            start = time.perf_counter()
            action = agent.act(observation)
            seconds.append(time.perf_counter() - start)
        except (Exception, SystemExit) as error:
            raise _failure(name, scene_name, f"frame {len(seconds)}", error) from error
        observation, _, _, truncated, _ = env.step(action)
    return replace(env.rollout(), seconds=np.array(seconds))


def run_scenes(
    make_agent: MakeAgent,
    env_id: str,
    env_kwargs: dict[str, Any] | None = None,
    scene_names: Sequence[str] | None = None,
    seed: int = 0,
    jobs: int = 1,
    finish: Finish | None = None,
    progress: Progress | None = None,
    name: str | None = None,
) -> list[Any]:
    """What ``finish`` makes of each scene (its Rollout if None), in the order of ``scene_names`` (None: all of them).

    Every scene gets an agent and an env of its own, so the results do not depend on ``jobs``, the number of processes;
    with 1 all runs in this one. ``make_agent`` and ``finish`` must be picklable for more. ``env_kwargs`` are keywords
    of MTPEnv; evaluation mode is on unless they say otherwise. ``progress`` is called with the name of every scene that
    is done, in the order of completion. ``name`` is what errors call the agent.
    """
    workers = Workers(jobs)
    kwargs = {"evaluation": True, **(env_kwargs or {})}
    known = MTPEnv(env_id, **kwargs).scene_names  # a wrong keyword or name shows here, not in a worker
    names = tuple(known if scene_names is None else scene_names)
    for scene in names:
        if scene not in known:
            raise UnknownNameError("scene", scene, known)
    return run_jobs([Job(make_agent, env_id, kwargs, scene, seed, name) for scene in names], workers, finish, progress)


@dataclass(frozen=True)
class Job:
    """One agent on one scene of one env; pickles as long as ``make_agent`` does."""

    make_agent: MakeAgent
    env_id: str
    env_kwargs: dict[str, Any]
    scene: str
    seed: int = 0
    name: str | None = None  # what errors call the agent


def run_jobs(
    jobs: Sequence[Job],
    workers: Workers = ALONE,
    finish: Finish | None = None,
    progress: Progress | None = None,
) -> list[Any]:
    """What ``finish`` makes of each job (its Rollout if None), in the order of ``jobs``, whoever does the work.

    What the jobs name (data root, submission) must be at the same path on every worker.
    """

    def done(place: int) -> None:
        if progress is not None:
            progress(jobs[place].scene)

    return parallel_map(_one_scene, [(job, finish) for job in jobs], workers, done)


def derived_seed(seed: int, scene_name: str, purpose: str) -> int:
    """A seed in [0, 2^31) for one purpose on one scene: the same in every process and on every machine."""
    content = hashlib.sha256(f"{seed}|{purpose}|{scene_name}".encode()).digest()
    return int.from_bytes(content[:4], "big") >> 1


def agent_task(env: MTPEnv, seed: int) -> Task:
    """What an agent is told before the scene: the task of ``env`` with the agent's seed, which names no scene."""
    return replace(env.task, seed=derived_seed(seed, "", "agent"))


def run_info(
    env: MTPEnv,
    agent: str,
    seed: int,
    parameters: dict[str, Any] | None = None,
    submission_digest: str = "",
    keywords: dict[str, Any] | None = None,
) -> RunInfo:
    """Record of a run on ``env``; ``keywords`` are further settings of the env that were not the default."""
    return RunInfo(
        env_id=env.card.id,
        card_digest=env.card.digest,
        observe=env.task.observe,
        samples=env.task.samples,
        split=env.card.source.split,
        keywords=keywords or {},
        agent=agent,
        parameters=parameters or {},
        submission_digest=submission_digest,
        seed=seed,
        definitions=DEFINITIONS,
        versions=library_versions(),
    )


def library_versions() -> dict[str, str]:
    """Versions of Python, of this library and of those that its numbers depend on."""
    found = {"python": platform.python_version(), "mtp-bench": __version__}
    for name in ("numpy", "scipy", "gymnasium", "numba", "torch", "scikit-learn"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _one_scene(job: Job, finish: Finish | None) -> Any:
    env = MTPEnv(job.env_id, **job.env_kwargs)
    try:
        agent = job.make_agent(agent_task(env, job.seed))
    except (Exception, SystemExit) as error:
        raise SubmissionError(f"agent {job.name or 'of this run'!r} cannot be built: {_text(error)}") from error
    rollout = run_scene(agent, env, job.scene, job.seed, job.name)
    return rollout if finish is None else finish(env.scene, rollout, env.card)


def _failure(agent: str, scene: str, where: str, error: BaseException) -> SubmissionError:
    return SubmissionError(f"agent {agent!r} failed on scene {scene!r} at {where}: {_text(error)}")


def _text(error: BaseException) -> str:
    return str(error) if isinstance(error, MtpBenchError) else f"{type(error).__name__}: {error}"
