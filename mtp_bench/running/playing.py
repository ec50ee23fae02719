"""Runs of agents through scenes, one after the other or in parallel.

Before them the user's cache is filled with the compiled kernels of trackers.
"""

import hashlib
import importlib
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
    SERIAL,
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
    parallel_map,
    unordered_map,
)
from ..env import MTPEnv
from .options import DEFAULTS, RunOptions

# Rooms whose modules register all kernels.
PLAYER_ROOMS = ("mtp_bench.tracking", "mtp_bench.prediction")


def all_kernels() -> list[Any]:
    """Import and return all kernels.

    The judge itself does not import trackers and predictors.
    """
    for room in PLAYER_ROOMS:
        facade = importlib.import_module(room)
        for name in facade.__all__:  # each is imported when it is first used
            getattr(facade, name)
    module = importlib.import_module("mtp_bench.tracking.kernels.compile")
    kernels: list[Any] = module.KERNELS
    return kernels


def compile_kernels(workers: Workers = SERIAL) -> None:
    """Compile the kernels that the user's cache lacks, in processes of this machine.

    To be called before workers start, which print nothing, and before sandboxes, which
    cannot write to the cache.
    """
    missing = [kernel for kernel in all_kernels() if not kernel.is_cached]
    # without a cache, each process has to compile for itself
    if not missing or not missing[0].can_be_cached():
        return
    functions = [kernel.function for kernel in missing]
    calls = [(function.__module__, function.__qualname__) for function in functions]
    if workers.count == 1 or len(missing) == 1:  # each kernel shows its own progress
        parallel_map(_compile, calls)
        return
    kernel_seconds = [kernel.seconds for kernel in missing]
    # no kernel is divided among workers
    expected_seconds = max(*kernel_seconds, sum(kernel_seconds) / workers.count)
    text = "compiling kernels of trackers and samplers, once per installation"
    with long_work(text, expected_seconds):
        parallel_map(_compile, calls, Workers(workers.count))


def _compile(module: str, name: str) -> None:
    getattr(importlib.import_module(module), name).compile()


MakeAgent = Callable[[Task], Agent]
Finish = Callable[[Scene, Rollout, Card], Any]
OnResult = Callable[[int, Any], object]  # takes the index of a job and its result
_MAX_ERROR_LETTERS = 500  # of an error of an agent
_LIBRARIES = ("numpy", "scipy", "gymnasium", "numba", "torch", "scikit-learn")


class AgentFailedError(SubmissionError):
    """An agent raised.

    ``reason`` says where and what, on one line.
    """

    def __init__(self, agent: str, reason: str) -> None:
        super().__init__(agent, reason)  # unpickling from a worker needs both
        self.reason = " ".join(reason.split())

    def __str__(self) -> str:
        return f"agent {self.args[0]!r} {self.reason}"


def run_scene(
    agent: Agent, env: MTPEnv, scene_name: str, seed: int, agent_name: str | None = None
) -> Rollout:
    """Return the rollout of ``agent`` on one scene of ``env``.

    It has the seconds that ``act`` took in each frame. ``scene_name``: one of
    ``env.scene_names``. Raises AgentFailedError if the agent raises, naming the agent
    (``agent_name``, or its class), scene and frame. The rollout counts invalid rows of
    actions; a strict env raises ActionError for them.
    """
    env_seed = derived_seed(seed, scene_name, "env")
    observation, _ = env.reset(seed=env_seed, options={"scene": scene_name})
    seconds: list[float] = []
    is_over = False
    step = "reset"
    try:
        agent.reset(agent_task(env, seed, scene_name))
        while not is_over:
            step = f"frame {len(seconds)}"
            begin = time.perf_counter()
            action = agent.act(observation)
            seconds.append(time.perf_counter() - begin)
            step = ""  # errors below are the env's
            observation, _, is_over, *_ = env.step(action)
    except BaseException as error:
        if not step or isinstance(error, KeyboardInterrupt):  # of the user
            raise
        reason = f"failed on scene {scene_name!r} at {step}: {_error_text(error)}"
        raise AgentFailedError(agent_name or type(agent).__name__, reason) from error
    return replace(env.rollout(), seconds=np.array(seconds))


@dataclass(frozen=True)
class Job:
    """One agent on one scene of one env.

    It can be pickled if ``make_agent`` can.
    """

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
    """Return the jobs of a submission on ``scenes`` of an env, in evaluation mode.

    ``env``: id, path of a card, or card. ``keywords``: keywords of `MTPEnv`; without
    ``observe`` the env has the mode of the manifest. ``parameters``: parameters of the
    agent; None: those of the manifest. ``label``: name of the agent in errors; None:
    name of the submission.
    """
    if parameters is None:
        parameters = submission.parameters
    make = submission.factory(parameters)
    keywords = {"observe": submission.compare.observe, **keywords, "evaluation": True}
    agent_name = label or submission.name
    return [Job(make, env, keywords, scene, seed, agent_name) for scene in scenes]


def run_jobs(
    jobs: Sequence[Job],
    options: RunOptions = DEFAULTS,
    finish: Finish | None = None,
    on_result: OnResult | None = None,
    caught: bool = False,
) -> list[Any]:
    """Return the results of ``finish`` for each job, in the order of ``jobs``.

    Without ``finish`` they are rollouts. Only workers and progress of ``options`` are
    used. The data root and the submission of a job must be at the same path on every
    worker. ``on_result`` is called in this process with every result. Raises
    AgentFailedError; with ``caught`` the error is the result of its job, and the others
    go on.
    """
    workers = options.workers
    are_submissions = [isinstance(job.make_agent, SubmissionFactory) for job in jobs]
    if workers.count > 1 and any(are_submissions):
        compile_kernels(workers)
    agents = list(dict.fromkeys(job.agent for job in jobs))
    agents_text = agents[0] if len(agents) == 1 else f"{len(agents)} agents"
    calls = [(job, finish, caught) for job in jobs]
    results: dict[int, Any] = {}
    with long_work(f"running {agents_text}", progress=options.progress) as progress:
        progress.started(len(jobs))
        for job_index, result in _outcomes(_run_job, calls, workers, caught):
            results[job_index] = result
            progress.done(jobs[job_index].scene)
            if on_result is not None:
                on_result(job_index, result)
    return [results[job_index] for job_index in range(len(jobs))]


def _outcomes(
    function: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    workers: Workers,
    caught: bool,
) -> Iterator[tuple[int, Any]]:
    """Yield index and result of each call of ``function``.

    The first argument of a call is a job. If a process ends, with ``caught``, the calls
    that remain are made agent by agent, to find the agent that ended it.
    """
    remaining = dict.fromkeys(range(len(calls)))
    try:
        for call_index, result in unordered_map(function, calls, workers):
            del remaining[call_index]
            yield call_index, result
    except WorkerDiedError:
        if not caught:
            raise
    by_agent: dict[str, list[int]] = {}
    for call_index in remaining:
        by_agent.setdefault(calls[call_index][0].agent, []).append(call_index)
    for agent, indices in by_agent.items():
        agent_calls = [calls[call_index] for call_index in indices]
        for position, result in _agent_outcomes(function, agent, agent_calls, workers):
            yield indices[position], result


def _agent_outcomes(
    function: Callable[..., Any],
    agent: str,
    calls: Sequence[tuple[Any, ...]],
    workers: Workers,
) -> Iterator[tuple[int, Any]]:
    """Yield index and result of each call of an agent that may end its process."""
    remaining = dict.fromkeys(range(len(calls)))
    try:
        for index, result in unordered_map(function, calls, workers, own_process=True):
            del remaining[index]
            yield index, result
    except WorkerDiedError:
        reason = (
            "ended its process: it exited, crashed, or memory ran out "
            "(then take fewer processes, --jobs)"
        )
        for index in remaining:
            yield index, AgentFailedError(agent, reason)


def first_errors(
    jobs: Sequence[Job], options: RunOptions = DEFAULTS
) -> list[AgentFailedError | None]:
    """Return the errors of building the agent of each job and resetting it once.

    None for an agent that is ready.
    """
    calls = [(job,) for job in jobs]
    results = dict(_outcomes(_first_error, calls, options.workers, caught=True))
    return [results[index] for index in range(len(jobs))]


def derived_seed(seed: int, scene_name: str, purpose: str) -> int:
    """Return a seed in [0, 2^31) for one purpose on one scene.

    It is the same in every process and on every machine.
    """
    content = hashlib.sha256(f"{seed}|{purpose}|{scene_name}".encode()).digest()
    # 31 of 32 bits
    return int.from_bytes(content[:4], "big") >> 1


def agent_task(env: MTPEnv, seed: int, scene_name: str = "") -> Task:
    """Return the task of ``env`` with the agent's own seed on one scene.

    Without a name, it is for an agent that waits for a scene. The seed is a hash of
    both, so it shows neither the number nor the order of the runs. Where ``seed`` and
    names are public, a table of such hashes tells the scene.
    """
    return replace(env.task, seed=derived_seed(seed, scene_name, "agent"))


def library_versions() -> dict[str, str]:
    """Return the versions of Python, of this library and of those it depends on."""
    versions = {"python": platform.python_version(), "mtp-bench": __version__}
    for library_name in _LIBRARIES:
        try:
            versions[library_name] = importlib.metadata.version(library_name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def _run_job(job: Job, finish: Finish | None, caught: bool) -> Any:
    env = MTPEnv(job.env, **job.env_keywords)
    try:
        # an agent that changes how errors and warnings show does so for itself
        with np.errstate(), warnings.catch_warnings():
            agent = _build(job, env)
            rollout = run_scene(agent, env, job.scene, job.seed, job.agent)
    except AgentFailedError as error:
        if not caught:
            raise
        return error.with_traceback(None)
    return rollout if finish is None else finish(env.scene, rollout, env.card)


def _first_error(job: Job) -> AgentFailedError | None:
    try:
        _build(job, MTPEnv(job.env, **job.env_keywords), reset=True)
    except AgentFailedError as error:
        return error.with_traceback(None)
    except MtpBenchError as error:  # of its sizes, or of what it observes
        return AgentFailedError(job.agent, f"cannot run here: {error}")
    return None


def _build(job: Job, env: MTPEnv, reset: bool = False) -> Agent:
    """Build the agent of a job, and ``reset`` it once.

    Raises AgentFailedError.
    """
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
        reason = f"cannot be {step}: {_error_text(error)}"
        raise AgentFailedError(job.agent, reason) from error
    return agent


def _error_text(error: BaseException) -> str:
    """Return the text of an agent's error, which may be long, or raise when read."""
    kind_text = "" if isinstance(error, MtpBenchError) else f"{type(error).__name__}: "
    try:
        return clean_text(f"{kind_text}{error}", _MAX_ERROR_LETTERS)
    except Exception:
        return f"{kind_text}its text cannot be read"
