"""`check_agent`: checks of the contract of an agent, under ordinary and extreme conditions."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...agent import missing_methods
from ...core import MtpBenchError, Observation, Task, require_known, starts_of
from ...env import Feed, MTPEnv
from ...scoring import mean_plain_error, score_scene
from ..playing import MakeAgent, agent_task
from .playing import AgentError, Finding, Suite, first_difference, play, play_made_up

Findings = Iterator[Finding]
SCENES = 2  # checked unless scenes are named
MOTION_TOLERANCE = (
    0.05  # of the score, for the rounding of forecasts and for draws along the axes
)
_SPACING = 6.0  # m between detections
_SPEED = 2.0  # m/s along x
_FULL = np.array([False, True, True, True, False, False, True])


def check_agent(
    make_agent: MakeAgent,
    env_id: str = "MTP-Intersection-v0",
    scenes: Sequence[str] | None = None,
    env_keywords: dict[str, Any] | None = None,
    seed: int = 0,
) -> list[Finding]:
    """Findings of all checks of an agent, with an "ok" for each check that passes; an "error" means that it fails.

    ``make_agent`` takes a task and returns an agent, as ``load_submission(path).build`` does. It plays the first two
    ``scenes`` of the env ``env_id``, or those named, several times: to the end, again, after another scene, with
    overwritten observations, turned and shifted, and frames without detections and full of them. Its exceptions become
    findings. ``env_keywords``: further keywords of the env, such as ``data``; ``seed``: of the run.

    Raises MtpBenchError for an unknown env, scene or keyword.
    """
    keywords = {"evaluation": True, **(env_keywords or {}), "strict": False}
    env = MTPEnv(env_id, **keywords)
    chosen = tuple(env.scene_names[:SCENES] if scenes is None else scenes)
    for scene in chosen:
        require_known("scene", scene, env.scene_names)
    if not chosen:
        raise MtpBenchError(
            "no scene to check on: expected at least one name in scenes"
        )
    suite = Suite(make_agent, env_id, keywords, seed, env, chosen)
    findings: list[Finding] = []
    for name, check, passed in _CHECKS:
        before = len(findings)
        try:
            for finding in check(suite):
                findings.append(replace(finding, check=name))
        except AgentError as error:
            findings.append(replace(error.finding, check=name))
            if name in ("build", "contract"):
                break  # all other checks would fail likewise
        if len(findings) == before:
            findings.append(Finding("ok", name, passed))
    return findings


def _builds(suite: Suite) -> Findings:
    agent: object = suite.agent()
    missing = missing_methods(agent)
    if missing:
        got = f"{type(agent).__name__} without {' and '.join(missing)}"
        expected = "reset(task) and act(observation)"
        raise AgentError(Finding("error", "", got, expected, "build", "write them"))
    return iter(())


def _contract(suite: Suite) -> Findings:
    """Play all scenes with one agent, and check each action."""
    agent = suite.agent()
    scores = []
    for scene in suite.scenes:
        suite.passes.append(play(agent, suite.env, scene, suite.seed))
        scores.append(score_scene(suite.env.scene, suite.env.rollout(), suite.env.card))
    suite.score = mean_plain_error(scores)
    results = [seen.finding() for seen in suite.problems.values()]
    yield from results
    if any(finding.level == "error" for finding in results):
        return
    actions = [action for played in suite.passes for action in played.actions]
    for kind, field in (("track", "track_id"), ("forecast", "object_class")):
        if not any(len(getattr(action, field)) for action in actions):
            expected = f"{kind}s of the detected objects"
            yield Finding(
                "warning", "", f"no sound {kind} in any frame", expected, suite.where
            )


def _deterministic(suite: Suite) -> Findings:
    where = first_difference(suite.passes[0], suite.play())
    if where:
        suite.deterministic = False
        got = "a second agent with the same seed acts differently"
        advice = "draw from np.random.default_rng(task.seed), made in reset"
        yield Finding("error", "", got, "the same actions", where, advice)


def _forgets(suite: Suite) -> Findings:
    agent, first = suite.agent(), suite.scenes[0]
    for scene in suite.scenes[1:] or suite.scenes:
        play(agent, suite.env, scene, suite.seed)
    where = first_difference(suite.passes[0], play(agent, suite.env, first, suite.seed))
    if where and suite.deterministic:
        got, expected = (
            "after another scene the actions differ",
            "the actions of a new agent",
        )
        yield Finding(
            "error",
            "",
            got,
            expected,
            where,
            "make everything that changes anew in reset",
        )


def _leaves_observations(suite: Suite) -> Findings:
    written = next((played.written for played in suite.passes if played.written), "")
    if written:
        expected, advice = (
            "an unchanged observation",
            "copy arrays before you change them",
        )
        yield Finding(
            "warning", "", "writes into the observation", expected, written, advice
        )
    where = first_difference(suite.passes[0], suite.play(scribble=True))
    if where and suite.deterministic:
        got = "actions change when an earlier observation is overwritten"
        advice = "copy arrays that you keep: they may be used again for the next frame"
        yield Finding("error", "", got, "no references kept", where, advice)


def _extremes(suite: Suite) -> Findings:
    """Play frames without detections and full of them."""
    task = agent_task(suite.env, suite.seed)
    faulty = {
        name for name, _ in suite.problems
    }  # fields that were wrong in the first passes already
    for (name, _), seen in play_made_up(
        suite.agent(), task, extreme_frames(task)
    ).problems.items():
        if name not in faulty:
            yield seen.finding()


def _unmoved(suite: Suite) -> Findings:
    """Compare the score with that on turned and shifted coordinates: a lookup table fails."""
    env = MTPEnv(suite.env_id, **dict(suite.keywords, rigid_motion=True))
    scores = []
    for scene in suite.scenes:
        play(suite.agent(env), env, scene, suite.seed, turn=1)
        scores.append(score_scene(env.scene, env.rollout(), env.card))
    moved = mean_plain_error(scores)
    if moved is None or suite.score is None:  # no targets
        return
    if abs(moved - suite.score) > MOTION_TOLERANCE * max(moved, suite.score):
        got = f"the plain error is {moved:.3f} m with turned and shifted coordinates, {suite.score:.3f} m without"
        advice = "do not depend on the position of the scene or on the axes"
        yield Finding(
            "error",
            "",
            got,
            f"the same within {MOTION_TOLERANCE:.0%}",
            suite.where,
            advice,
        )


def _latency(suite: Suite) -> Findings:
    """State the time per frame; always ok."""
    seconds = np.concatenate([played.seconds[1:] for played in suite.passes])
    if len(seconds):
        p50, p95 = 1000.0 * np.percentile(seconds, [50, 95])
        first = 1000.0 * max(played.seconds[0] for played in suite.passes)
        text = f"{p50:.1f} ms per frame (p50), {p95:.1f} ms (p95); slowest first frame {first:.0f} ms"
        yield Finding("ok", "", text)


def extreme_frames(task: Task) -> list[tuple[str, Observation]]:
    """Pairs of description and observation: frames without detections (3 of 7), and with as many as fit."""
    frames, size = len(_FULL), task.detections
    frame, column = (
        np.repeat(np.flatnonzero(_FULL), size),
        np.tile(np.arange(size), int(_FULL.sum())),
    )
    side = int(np.ceil(np.sqrt(size)))
    box = np.tile([0.0, 0, 0, 0, 4.0, 1.8, 1.5], (len(column), 1))
    box[:, 0] = _SPACING * (column % side) + _SPEED * frame * task.dt
    box[:, 1] = _SPACING * (column // side)
    feed = Feed(
        start=starts_of(size * _FULL),
        size=size,
        box=box,
        velocity=np.tile([_SPEED if task.velocity else 0.0, 0.0], (len(column), 1)),
        score=np.ones(len(column)),
        class_id=column % len(task.classes),
        object_id=column if task.observe != "detections" else None,
        ego=np.zeros((frames, 4)),
        time=task.dt * np.arange(frames),
        dt=np.full(frames, task.dt),  # in the first frame too, as in the env
        dropped=np.zeros(frames, dtype=np.int64),
    )
    words = {True: "as many detections as fit", False: "no detections"}
    return [
        (f"frame {t} ({words[bool(_FULL[t])]})", feed.observe(t)) for t in range(frames)
    ]


_CHECKS: tuple[
    tuple[str, Callable[[Suite], Findings], str], ...
] = (  # name, check, text shown if it finds nothing
    ("build", _builds, "builds an agent"),
    ("contract", _contract, "every row of every action is sound"),
    ("determinism", _deterministic, "same seed, same actions"),
    ("reset", _forgets, "no state is carried from one scene to the next"),
    ("observations", _leaves_observations, "observations are neither written nor kept"),
    ("extremes", _extremes, "frames without detections and full of them work"),
    ("rigid motion", _unmoved, "turned and shifted coordinates give the same score"),
    ("latency", _latency, "too few frames to time"),
)
