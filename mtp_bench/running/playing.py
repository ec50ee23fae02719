"""Run agents through scenes, one after the other or in parallel."""

import hashlib
import importlib.metadata
import platform
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..agent import Agent, Submission, SubmissionFactory
from ..cards import Card
from ..core import (
    MtpBenchError,
    Rollout,
    Scene,
    SubmissionError,
    Task,
    WorkerDiedError,
    Workers,
    __version__,
    clean_text,
    long_work,
    unordered_map,
)
from ..env import MTPEnv
from .kernels import compile_kernels
from .options import DEFAULTS, RunOptions

MakeAgent = Callable[[Task], Agent]
Finish = Callable[[Scene, Rollout, Card], Any]
Finished = Callable[[int, Any], object]  # index of a job, and its result
_MOST_TEXT = 500  # characters of an error of an agent


class AgentFailedError(SubmissionError):
    """An agent raised; ``reason`` says where and what, on one line."""

    def __init__(self, agent: str, reason: str) -> None:
        super().__init__(agent, reason)  # both: workers send their errors home
        self.reason = " ".join(reason.split())

    def __str__(self) -> str:
        return f"agent {self.args[0]!r} {self.reason}"


def run_scene(
    agent: Agent, env: MTPEnv, scene_name: str, seed: int, name: str | None = None
) -> Rollout:
    """Rollout of ``agent`` on one scene of ``env``, with the seconds that ``act`` took per frame.

    ``scene_name``: one of ``env.scene_names``. Raises AgentFailedError, naming the agent (``name``, else its class),
    scene and frame, if the agent raises; the rollout counts invalid rows of actions (ActionError of a strict env).
    """
    name = name or type(agent).__name__
    observation, _ = env.reset(
        seed=derived_seed(seed, scene_name, "env"), options={"scene": scene_name}
    )
    seconds: list[float] = []
    over, place = False, "reset"
    try:
        agent.reset(agent_task(env, seed, scene_name))
        while not over:
            place = f"frame {len(seconds)}"
            start = time.perf_counter()
            action = agent.act(observation)
            seconds.append(time.perf_counter() - start)
            place = ""  # errors below are the env's
            observation, _, over, *_ = env.step(action)
    except BaseException as error:
        if not place or isinstance(error, KeyboardInterrupt):  # of the user
            raise
        raise AgentFailedError(
            name, f"failed on scene {scene_name!r} at {place}: {_text(error)}"
        ) from error
    return replace(env.rollout(), seconds=np.array(seconds))


@dataclass(frozen=True)
class Job:
    """One agent on one scene of one env; it can be pickled if ``make_agent`` can."""

    make_agent: MakeAgent
    env: str | Card  # id, path of a card, or a card
    env_keywords: dict[str, Any]
    scene: str
    seed: int
    agent: str  # its name


def jobs_of(
    submission: Submission,
    env: str | Card,
    keywords: dict[str, Any],
    scenes: Sequence[str],
    seed: int = 0,
    parameters: dict[str, Any] | None = None,
    label: str | None = None,
) -> list[Job]:
    """Jobs of a submission on the ``scenes`` of an env (id, path of a card, or card) in evaluation mode.

    ``keywords``: of `MTPEnv`; without ``observe`` the env observes what the manifest states. ``parameters``: of the
    agent, else those of the manifest. ``label``: name of the agent in errors, else that of the submission.
    """
    make = submission.factory(
        submission.parameters if parameters is None else parameters
    )
    keywords = {"observe": submission.compare.observe, **keywords, "evaluation": True}
    return [
        Job(make, env, keywords, scene, seed, label or submission.name)
        for scene in scenes
    ]


def run_jobs(
    jobs: Sequence[Job],
    options: RunOptions = DEFAULTS,
    finish: Finish | None = None,
    finished: Finished | None = None,
    caught: bool = False,
) -> list[Any]:
    """Results of ``finish`` for each job (its Rollout if None), in the order of ``jobs``.

    Only workers and progress of ``options`` are used. The data root and the submission of a job must be at the same
    path on every worker. ``finished`` is called in this process with every result. Raises AgentFailedError; with
    ``caught`` the error is the result of its job, and the others go on.
    """
    if options.workers.count > 1 and any(
        isinstance(job.make_agent, SubmissionFactory) for job in jobs
    ):
        compile_kernels(options.workers)
    agents, results = {job.agent for job in jobs}, dict[int, Any]()
    label = "running " + (
        f"{len(agents)} agents" if len(agents) > 1 else "".join(agents)
    )
    with long_work(label, progress=options.progress) as told:
        told.started(len(jobs))
        for place, result in _outcomes(
            _one_scene, [(job, finish, caught) for job in jobs], options.workers, caught
        ):
            results[place] = result
            told.done(jobs[place].scene)
            if finished is not None:
                finished(place, result)
    return [results[place] for place in range(len(jobs))]


def _outcomes(
    function: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    workers: Workers,
    caught: bool,
) -> Iterator[tuple[int, Any]]:
    """Index and result of each call of ``function``, whose first argument is a job.

    If a process ends, with ``caught``, the calls that are left are made agent by agent.
    """
    left = dict.fromkeys(range(len(calls)))
    try:
        for place, result in unordered_map(function, calls, workers):
            del left[place]
            yield place, result
    except WorkerDiedError:
        if not caught:
            raise
    for agent in dict.fromkeys(calls[place][0].agent for place in left):
        places = [place for place in left if calls[place][0].agent == agent]
        try:
            for index, result in unordered_map(
                function, [calls[place] for place in places], workers, own_process=True
            ):
                del left[places[index]]
                yield places[index], result
        except WorkerDiedError:
            reason = "ended its process: it exited, crashed, or memory ran out (then take fewer processes, --jobs)"
            yield from (
                (place, AgentFailedError(agent, reason))
                for place in places
                if place in left
            )


def first_errors(
    jobs: Sequence[Job], options: RunOptions = DEFAULTS
) -> list[AgentFailedError | None]:
    """Errors of building the agent of each job and resetting it once for its scene; None for an agent that is ready."""
    results = dict(
        _outcomes(_first_error, [(job,) for job in jobs], options.workers, caught=True)
    )
    return [results[place] for place in range(len(jobs))]


def derived_seed(seed: int, scene_name: str, purpose: str) -> int:
    """A seed in [0, 2^31) for one purpose on one scene: the same in every process and on every machine."""
    content = hashlib.sha256(f"{seed}|{purpose}|{scene_name}".encode()).digest()
    return int.from_bytes(content[:4], "big") >> 1


def agent_task(env: MTPEnv, seed: int, scene_name: str = "") -> Task:
    """The task of ``env`` with the agent's own seed on one scene; without a name, for an agent that waits for a scene.

    The seed is a hash of both, so it shows neither the number nor the order of the runs. Where ``seed`` and names are
    public, a table of such hashes tells the scene.
    """
    return replace(env.task, seed=derived_seed(seed, scene_name, "agent"))


def library_versions() -> dict[str, str]:
    """Versions of Python, of this library and of those that its numbers depend on."""
    versions = {"python": platform.python_version(), "mtp-bench": __version__}
    for name in ("numpy", "scipy", "gymnasium", "numba", "torch", "scikit-learn"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def _one_scene(job: Job, finish: Finish | None, caught: bool) -> Any:
    env = MTPEnv(job.env, **job.env_keywords)
    try:
        with (
            np.errstate(),
            warnings.catch_warnings(),
        ):  # an agent that changes them changes them for itself
            rollout = run_scene(_built(job, env), env, job.scene, job.seed, job.agent)
    except AgentFailedError as error:
        if not caught:
            raise
        return error.with_traceback(None)
    return rollout if finish is None else finish(env.scene, rollout, env.card)


def _first_error(job: Job) -> AgentFailedError | None:
    try:
        _built(job, MTPEnv(job.env, **job.env_keywords), reset=True)
    except AgentFailedError as error:
        return error.with_traceback(None)
    except MtpBenchError as error:  # of its sizes, or of what it observes
        return AgentFailedError(job.agent, f"cannot run here: {error}")
    return None


def _built(job: Job, env: MTPEnv, reset: bool = False) -> Agent:
    """The agent of a job, and ``reset`` once; raises AgentFailedError."""
    task = agent_task(env, job.seed, job.scene)
    step = "built"
    try:
        agent = job.make_agent(task)
        step = "reset"
        if reset:
            agent.reset(task)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        raise AgentFailedError(
            job.agent, f"cannot be {step}: {_text(error)}"
        ) from error
    return agent


def _text(error: BaseException) -> str:
    """Text of an error of an agent, which may be long, or raise when it is read."""
    kind = "" if isinstance(error, MtpBenchError) else f"{type(error).__name__}: "
    try:
        return clean_text(f"{kind}{error}", _MOST_TEXT)
    except Exception:
        return f"{kind}its text cannot be read"
