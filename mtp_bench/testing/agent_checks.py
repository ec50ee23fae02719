"""`check_agent`: does an agent keep the contract, and what would it cost it not to?"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from ..env.environment import MTPEnv
from ..errors import MtpBenchError, UnknownNameError
from ..running.run import MakeAgent
from ..scoring import mean_plain_error
from .findings import AgentError, Finding
from .playing import Suite, another_clock, first_difference, play, score_of
from .stress_checks import extremes, latency, other_sizes, unmoved

SCENES = 2  # that are checked unless named
LARGEST_PICKLE = 1 << 20  # bytes


def check_agent(
    make_agent: MakeAgent,
    env_id: str = "MTP-Intersection-v0",
    scenes: Sequence[str] | None = None,
    env_keywords: dict[str, Any] | None = None,
    seed: int = 0,
) -> list[Finding]:
    """What the checks of an agent found, one "ok" for each that found nothing; an agent passes without an "error".

    ``make_agent`` takes a task and returns an agent, as ``load_submission(path).build`` does. It plays the first two
    ``scenes`` of the env ``env_id``, or those named, several times: to the end, again, after another scene, in other
    sizes, with overwritten observations, turned and shifted, and frames with no and with as many detections as fit.
    Whatever the agent raises becomes a finding. ``env_keywords`` are further keywords of the env (``data``), ``seed``
    is that of the run.

    Raises MtpBenchError for an env, a scene or a keyword that is not there.
    """
    keywords = {"evaluation": True, **(env_keywords or {}), "strict": False}
    env = MTPEnv(env_id, **keywords)
    chosen = tuple(env.scene_names[:SCENES] if scenes is None else scenes)
    for scene in chosen:
        if scene not in env.scene_names:
            raise UnknownNameError("scene", scene, env.scene_names)
    if not chosen:
        raise MtpBenchError("no scene to check on: expected at least one name in scenes")
    suite = Suite(make_agent, env_id, keywords, seed, env, chosen)
    findings: list[Finding] = []
    for name, check, expected in _CHECKS:
        found, failed = _found(name, check, suite)
        findings += found or [Finding("ok", name, expected)]
        if failed and name in ("build", "contract"):
            break  # every other check would say the same
    return findings


def _found(name: str, check: Callable[[Suite], Iterator[Finding]], suite: Suite) -> tuple[list[Finding], bool]:
    """What one check found, and whether the agent failed in it."""
    found: list[Finding] = []
    try:
        for finding in check(suite):
            found.append(replace(finding, check=name))
    except AgentError as failed:
        return [*found, replace(failed.finding, check=name)], True
    return found, False


def _builds(suite: Suite) -> Iterator[Finding]:
    agent: object = suite.agent()
    missing = [name for name in ("reset", "act") if not callable(getattr(agent, name, None))]
    if missing:
        got = f"{type(agent).__name__} without {' and '.join(missing)}"
        expected = "reset(task) and act(observation)"
        raise AgentError(Finding("error", "", got, expected, "build", "write them"))
    return iter(())


def _travels(suite: Suite) -> Iterator[Finding]:
    expected = "a path or a name"
    try:
        size = len(pickle.dumps(suite.make))
    except Exception as error:
        got = f"cannot be pickled ({type(error).__name__}: {error})"
        advice = "give a function of a module; `mtp-bench` itself sends the folder's path"
        yield Finding("warning", "", got, expected, "", advice)
        return
    if size > LARGEST_PICKLE:
        advice = "load weights in build, not before it"
        yield Finding("warning", "", f"pickles as {size >> 20} MiB", expected, "", advice)


def _contract(suite: Suite) -> Iterator[Finding]:
    """Play all scenes with one agent, and look at each answer."""
    agent = suite.agent()
    scores = []
    for scene in suite.scenes:
        suite.played.append(play(agent, suite.env, scene, suite.seed))
        scores.append(score_of(suite.env))
    suite.score = mean_plain_error(scores)
    found = [seen.finding() for seen in suite.problems.values()]
    yield from found
    if not any(finding.level == "error" for finding in found):
        answers = [answer for played in suite.played for answer in played.answers]
        for what, said in (("track", "track_id"), ("forecast", "object_class")):
            if not any(len(getattr(answer, said)) for answer in answers):
                expected = f"{what}s of what is detected"
                yield Finding("warning", "", f"no sound {what} in any frame", expected, suite.where)


def _deterministic(suite: Suite) -> Iterator[Finding]:
    where = first_difference(suite.played[0], suite.play())
    if where:
        suite.deterministic = False
        got = "a second agent with the same seed answers otherwise"
        advice = "draw from np.random.default_rng(task.seed), made in reset"
        yield Finding("error", "", got, "the same answers", where, advice)
        return
    with another_clock():
        later = suite.play()
    where = first_difference(suite.played[0], later)
    if where:
        advice = "count steps, not seconds: a run cannot be repeated otherwise"
        yield Finding("warning", "", "answers depend on the clock", "the same answers", where, advice)


def _forgets(suite: Suite) -> Iterator[Finding]:
    agent, first = suite.agent(), suite.scenes[0]
    for scene in suite.scenes[1:] or suite.scenes:
        play(agent, suite.env, scene, suite.seed)
    where = first_difference(suite.played[0], play(agent, suite.env, first, suite.seed))
    if where and suite.deterministic:
        got, expected = "after another scene the answers differ", "the answers of an agent that saw nothing before"
        yield Finding("error", "", got, expected, where, "make everything that changes anew in reset")


def _leaves_observations(suite: Suite) -> Iterator[Finding]:
    written = next((played.written for played in suite.played if played.written), "")
    if written:
        expected, advice = "an observation that is left as it was", "copy what you change"
        yield Finding("warning", "", "writes into the observation", expected, written, advice)
    where = first_difference(suite.played[0], suite.play(scribble=True))
    if where and suite.deterministic:
        got = "answers change when an earlier observation is overwritten"
        advice = "copy what you keep: the arrays may be used again for the next frame"
        yield Finding("error", "", got, "no references kept", where, advice)


# name, check, what is shown when it finds nothing; the findings of a check get its name
_CHECKS: tuple[tuple[str, Callable[[Suite], Iterator[Finding]], str], ...] = (
    ("build", _builds, "builds an agent"),
    ("travels", _travels, "goes to other processes as a path or a name"),
    ("contract", _contract, "every row of every answer is sound"),
    ("determinism", _deterministic, "same seed, same answers"),
    ("reset", _forgets, "nothing is carried from one scene to the next"),
    ("observations", _leaves_observations, "observations are neither written nor kept"),
    ("sizes", other_sizes, "other numbers of tracks, objects, hypotheses and samples work"),
    ("extremes", extremes, "frames without detections and full of them work"),
    ("rigid motion", unmoved, "turned and shifted coordinates give the same score"),
    ("latency", latency, "too few frames to time"),
)
