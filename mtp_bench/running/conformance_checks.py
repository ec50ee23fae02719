"""`check_agent`: checks of the contract of an agent, in usual and extreme frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..agent import missing_methods
from ..core import MtpBenchError, Observation, Task, require_known, starts_of
from ..env import Feed, MTPEnv
from ..scoring import mean_plain_error, score_scene
from .conformance_playing import (
    AgentError,
    Finding,
    Suite,
    first_difference,
    play,
    play_made_up,
)
from .playing import MakeAgent, agent_task

Findings = Iterator[Finding]
SCENES = 2  # checked unless scenes are named
# Share of the score, for the rounding of forecasts and for draws along the axes.
MOTION_TOLERANCE = 0.05
_SPACING_M = 6.0  # between detections
_SPEED_MPS = 2.0  # along x
# Frames of the made-up scene with as many detections as fit.
_FULL_FRAMES = np.array([False, True, True, True, False, False, True])


def check_agent(
    make_agent: MakeAgent,
    env_id: str = "MTP-Intersection-v0",
    scenes: Sequence[str] | None = None,
    env_keywords: dict[str, Any] | None = None,
    seed: int = 0,
) -> list[Finding]:
    """Check that an agent keeps the contract.

    The findings have an "ok" for each check that passes; an "error" means that it
    fails. ``make_agent`` takes a task and returns an agent, as
    ``load_submission(path).build`` does. It plays the first two ``scenes`` of the env
    ``env_id``, or those named, several times: to the end, again, after another scene,
    with overwritten observations, turned and shifted, and frames without detections and
    full of them. Its exceptions become findings. ``env_keywords``: further keywords of
    the env, such as ``data``. ``seed``: seed of the run.

    Raises MtpBenchError for an unknown env, scene or keyword.
    """
    keywords = {"evaluation": True, **(env_keywords or {}), "strict": False}
    env = MTPEnv(env_id, **keywords)
    scene_names = tuple(env.scene_names[:SCENES] if scenes is None else scenes)
    for scene_name in scene_names:
        require_known("scene", scene_name, env.scene_names)
    if not scene_names:
        raise MtpBenchError(
            "no scene to check on: expected at least one name in scenes"
        )
    suite = Suite(make_agent, env_id, keywords, seed, env, scene_names)
    findings: list[Finding] = []
    for check_name, check, passed_text in _CHECKS:
        results, raised = _results_of(check(suite))
        if not results:
            results = [Finding("ok", "", passed_text)]
        # checks leave the name of the check empty
        findings += [replace(finding, check=check_name) for finding in results]
        if raised and check_name in ("build", "contract"):
            break  # all other checks would fail likewise
    return findings


def _results_of(check: Findings) -> tuple[list[Finding], bool]:
    """Return the findings of a check, and whether an error of the agent ended it."""
    results: list[Finding] = []
    try:
        for finding in check:  # those before an error stay
            results.append(finding)
    except AgentError as error:
        return [*results, error.finding], True
    return results, False


def _builds(suite: Suite) -> Findings:
    agent: object = suite.agent()
    missing = missing_methods(agent)
    if missing:
        yield Finding(
            "error",
            check="",
            got=f"{type(agent).__name__} without {' and '.join(missing)}",
            expected="reset(task) and act(observation)",
            where="build",
            advice="write them",
        )


def _contract(suite: Suite) -> Findings:
    """Play all scenes with one agent, and check each action."""
    agent = suite.agent()
    scores = []
    for scene in suite.scenes:
        suite.passes.append(play(agent, suite.env, scene, suite.seed))
        scores.append(score_scene(suite.env.scene, suite.env.rollout(), suite.env.card))
    suite.score = mean_plain_error(scores)
    results = [count.finding() for count in suite.problems.values()]
    yield from results
    # wrong rows were taken out, so that the rest may be empty for this reason
    if any(finding.level == "error" for finding in results):
        return
    actions = [action for played in suite.passes for action in played.actions]
    for kind, field_name in (("track", "track_id"), ("forecast", "object_class")):
        if not any(len(getattr(action, field_name)) for action in actions):
            got = f"no sound {kind} in any frame"
            expected = f"{kind}s of the detected objects"
            yield Finding("warning", "", got, expected, suite.where)


def _deterministic(suite: Suite) -> Findings:
    where = first_difference(suite.passes[0], suite.play())
    if where:
        suite.deterministic = False
        yield Finding(
            "error",
            check="",
            got="a second agent with the same seed acts differently",
            expected="the same actions",
            where=where,
            advice="draw from np.random.default_rng(task.seed), made in reset",
        )


def _forgets(suite: Suite) -> Findings:
    """Play another scene before the first one."""
    agent = suite.agent()
    # an only scene is played twice
    for scene in suite.scenes[1:] or suite.scenes:
        play(agent, suite.env, scene, suite.seed)
    again = play(agent, suite.env, suite.scenes[0], suite.seed)
    where = first_difference(suite.passes[0], again)
    if where and suite.deterministic:
        yield Finding(
            "error",
            check="",
            got="after another scene the actions differ",
            expected="the actions of a new agent",
            where=where,
            advice="make everything that changes anew in reset",
        )


def _leaves_observations(suite: Suite) -> Findings:
    """Look for observations that were written into, and for references kept."""
    written = [played.written for played in suite.passes if played.written]
    if written:
        yield Finding(
            "warning",
            check="",
            got="writes into the observation",
            expected="an unchanged observation",
            where=written[0],
            advice="copy arrays before you change them",
        )
    where = first_difference(suite.passes[0], suite.play(scribble=True))
    if where and suite.deterministic:
        yield Finding(
            "error",
            check="",
            got="actions change when an earlier observation is overwritten",
            expected="no references kept",
            where=where,
            advice="copy arrays that you keep: they may be used again for the next "
            "frame",
        )


def _extremes(suite: Suite) -> Findings:
    """Play frames without detections and full of them."""
    task = agent_task(suite.env, suite.seed)
    # fields with problems in usual frames, which `_contract` reports
    known_fields = {field_name for field_name, _ in suite.problems}
    played = play_made_up(suite.agent(), task, extreme_frames(task))
    for (field_name, _), count in played.problems.items():
        if field_name not in known_fields:
            yield count.finding()


def _unmoved(suite: Suite) -> Findings:
    """Compare the score with that on turned and shifted coordinates.

    An agent that looks up known places fails.
    """
    env = MTPEnv(suite.env_id, **dict(suite.keywords, rigid_motion=True))
    scores = []
    for scene in suite.scenes:
        play(suite.agent(env), env, scene, suite.seed, turn=1)
        scores.append(score_scene(env.scene, env.rollout(), env.card))
    moved_score = mean_plain_error(scores)
    if moved_score is None or suite.score is None:  # no targets
        return
    tolerance = MOTION_TOLERANCE * max(moved_score, suite.score)
    if abs(moved_score - suite.score) > tolerance:
        yield Finding(
            "error",
            check="",
            got=f"the plain error is {moved_score:.3f} m with turned and shifted "
            f"coordinates, {suite.score:.3f} m without",
            expected=f"the same within {MOTION_TOLERANCE:.0%}",
            where=suite.where,
            advice="do not depend on the position of the scene or on the axes",
        )


def _latency(suite: Suite) -> Findings:
    """State the time per frame, which is always "ok"."""
    # the first frame, in which agents start, is stated apart
    seconds = np.concatenate([played.seconds[1:] for played in suite.passes])
    if len(seconds):
        p50, p95 = 1000.0 * np.percentile(seconds, [50, 95])
        first_ms = 1000.0 * max(played.seconds[0] for played in suite.passes)
        latency_text = (
            f"{p50:.1f} ms per frame (p50), {p95:.1f} ms (p95); "
            f"slowest first frame {first_ms:.0f} ms"
        )
        yield Finding("ok", "", latency_text)


def extreme_frames(task: Task) -> list[tuple[str, Observation]]:
    """Return 7 pairs of description and observation.

    In 3 frames there are no detections, in 4 as many as fit.
    """
    frames = len(_FULL_FRAMES)
    row_count = task.detections
    full_frames = np.flatnonzero(_FULL_FRAMES)
    frame = np.repeat(full_frames, row_count)
    number = np.tile(np.arange(row_count), len(full_frames))  # within its frame
    grid_side = int(np.ceil(np.sqrt(row_count)))
    # x, y, z, yaw, and the size of a car
    box = np.tile([0.0, 0, 0, 0, 4.0, 1.8, 1.5], (len(number), 1))
    box[:, 0] = _SPACING_M * (number % grid_side) + _SPEED_MPS * frame * task.dt
    box[:, 1] = _SPACING_M * (number // grid_side)
    speed = _SPEED_MPS if task.velocity else 0.0
    feed = Feed(
        start=starts_of(row_count * _FULL_FRAMES),
        size=row_count,
        box=box,
        velocity=np.tile([speed, 0.0], (len(number), 1)),
        score=np.ones(len(number)),
        class_id=number % len(task.classes),
        object_id=number if task.observe != "detections" else None,
        ego=np.zeros((frames, 4)),
        time=task.dt * np.arange(frames),
        dt=np.full(frames, task.dt),  # in the first frame too, as in the env
        dropped=np.zeros(frames, dtype=np.int64),
    )
    described_frames = []
    for t, is_full in enumerate(_FULL_FRAMES):
        content = "as many detections as fit" if is_full else "no detections"
        described_frames.append((f"frame {t} ({content})", feed.observe(t)))
    return described_frames


# Name, check, and the text that is shown if it finds nothing.
_CHECKS: tuple[tuple[str, Callable[[Suite], Findings], str], ...] = (
    ("build", _builds, "builds an agent"),
    ("contract", _contract, "every row of every action is sound"),
    ("determinism", _deterministic, "same seed, same actions"),
    ("reset", _forgets, "no state is carried from one scene to the next"),
    ("observations", _leaves_observations, "observations are neither written nor kept"),
    ("extremes", _extremes, "frames without detections and full of them work"),
    ("rigid motion", _unmoved, "turned and shifted coordinates give the same score"),
    ("latency", _latency, "too few frames to time"),
)
