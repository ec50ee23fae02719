"""Run a submission scene by scene, each in a process that knows only the messages it is sent."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...agent import load_submission, make_action
from ...cards import Card
from ...core import (
    NO_PROGRESS,
    SERIAL,
    Progress,
    SubmissionError,
    Workers,
    unordered_map,
)
from ...env import MTPEnv
from ...running import agent_task, compile_kernels, derived_seed
from ...sources import scene_digest
from .exchange import Exchange, answer_bytes
from .layout import Image, image_of, layout_for
from .limits import Limits, SandboxBackend, SceneRun
from .process import AgentProcess, SandboxSpec
from .sandbox import sandbox_backend

_compile_once = cache(compile_kernels)


def run_isolated(
    submission: str | Path,
    env_id: str | Card,
    env_keywords: dict[str, Any],
    scene: str,
    seed: int = 0,
    parameters: dict[str, Any] | None = None,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
    image: Image | None = None,
    backend: SandboxBackend | None = None,
) -> SceneRun:
    """Run one scene with an agent in its own process.

    ``submission``: its folder, or the name of a baseline. ``env_id``: id, path or
    card. ``env_keywords``: of MTPEnv; the env observes what the submission asks for
    unless they say otherwise. ``parameters``: of the agent; None: those of the
    manifest. ``image``: the copy that runs; another machine makes an equal one. None:
    of the files as they are. ``backend``: the sandbox; None: the one that works here,
    if any.

    The rollout of an agent that follows the rules equals that of
    `running.run.run_scene`, but for the times. An unanswered frame has no rows. Never
    raises for actions of an agent; raises MtpBenchError for a folder that is not a
    submission, an unknown scene or missing data.
    """
    if backend is None:
        # called alone or on another machine: kernels that an agent compiles are not kept
        _compile_once()
    loaded = load_submission(submission)
    keywords = {"observe": loaded.compare.observe, **env_keywords, "evaluation": True}
    env = MTPEnv(env_id, **keywords)
    env_seed = derived_seed(seed, scene, "env")
    observation, _ = env.reset(seed=env_seed, options={"scene": scene})
    expected = image
    if image is None or not image.submission.is_dir():
        image = image_of(loaded, env.card.id, env.card.weights_of)
    if expected is not None and image.digest != expected.digest:
        raise SubmissionError(
            f"{loaded.path}: its files changed while it ran, "
            "expected one submission in all scenes; run it again"
        )
    paths = [
        getattr(env.card.source, "folder", None),
        getattr(env.card.source, "detections", None),
        keywords.get("tracks"),
    ]
    user_files = [Path(path).expanduser() for path in paths if path is not None]
    layout = layout_for(image, keywords.get("data"), user_files)
    spec = SandboxSpec(layout, image, backend or sandbox_backend())
    with AgentProcess(limits, spec, answer_bytes(env.action_space, limits)) as process:
        setup = process.setup(loaded.parameters if parameters is None else parameters)
        seal = seal_start(env.card.digest, scene, seed)
        exchange = Exchange(process, limits, env.action_space, seal)
        exchange.open(setup, asdict(agent_task(env, seed, scene)))
        # 0 boxes, classes and forecasts
        nothing = np.zeros((0, 7)), np.zeros(0, int), np.zeros((0, env.task.future, 2))
        no_objects = make_action(env.task, *nothing, checked=False)
        seconds: list[float] = []
        terminated = False
        while not terminated:
            action, answer_seconds = exchange.ask(observation)
            seconds.append(answer_seconds)
            if action is None:
                action = no_objects
            observation, _, terminated, *_ = env.step(action)
        run = exchange.result(replace(env.rollout(), seconds=np.array(seconds)))
        return replace(run, scene_digest=scene_digest(env.scene))


def run_isolated_scenes(
    submission: str | Path,
    env_id: str | Card,
    env_keywords: dict[str, Any],
    seed: int = 0,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
    *,
    scenes: Sequence[str],
    workers: Workers = SERIAL,
    progress: Progress = NO_PROGRESS,
    finished: Callable[[SceneRun], None] = lambda run: None,
    image: Image | None = None,
) -> list[SceneRun]:
    """Run every scene by `run_isolated`.

    Results have the order of ``scenes``.
    Every scene has an agent of its own: a failure ends at most its scene. ``finished``
    is called with every finished scene, in the order of completion and in this process.
    ``image``: the copy that runs in all scenes; None: of the files as they are.
    """
    if workers.scheduler is None:
        compile_kernels(workers)
    card = MTPEnv(env_id, **env_keywords).card
    if image is None:
        image = image_of(load_submission(submission), card.id, card.weights_of)
    # decided once, so that all scenes run in the same sandbox; other machines decide
    # for themselves
    backend = sandbox_backend() if workers.scheduler is None else None
    parameters = None  # those of the manifest
    settings = (seed, parameters, limits, image, backend)
    calls = [(submission, env_id, env_keywords, scene, *settings) for scene in scenes]
    runs: dict[int, SceneRun] = {}
    for index, run in unordered_map(run_isolated, calls, workers):
        runs[index] = run
        finished(run)
        progress.done(scenes[index])
    return [runs[index] for index in range(len(scenes))]


def seal_start(card_digest: str, scene: str, seed: int) -> bytes:
    """Return the start of the hash chain of one scene."""
    text = json.dumps(["mtp-bench seal 1", card_digest, scene, seed])
    return hashlib.sha256(text.encode()).digest()
