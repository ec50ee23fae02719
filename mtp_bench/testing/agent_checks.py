"""`check_agent`: does an agent keep the contract, and what would it cost it not to?"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from typing import Any

from ..env.environment import MTPEnv
from ..errors import MtpBenchError, UnknownNameError
from ..running.run import MakeAgent
from ..scoring import SceneScore, mean_error, score_scene
from .findings import Finding, failure
from .playing import another_clock, first_difference, play
from .stress_checks import extremes, latency, other_sizes, unmoved
from .suite import BuildError, Suite

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
    ``scenes`` of the env, or those named, several times: to the end, again, after another scene, in other sizes, with
    overwritten observations, turned and shifted, and frames with no and with as many detections as fit. Whatever the
    agent raises becomes a finding. ``env_keywords`` are further keywords of the env (``data``).

    Raises MtpBenchError for an env, a scene or a keyword that is not there.
    """
    keywords = {"evaluation": True, **(env_keywords or {})}
    env = MTPEnv(env_id, **keywords)
    chosen = tuple(env.scene_names[:SCENES] if scenes is None else scenes)
    for scene in chosen:
        if scene not in env.scene_names:
            raise UnknownNameError("scene", scene, env.scene_names)
    suite = Suite(make_agent, env_id, keywords, seed, env, chosen)
    if not chosen:
        raise MtpBenchError("no scene to check on: expected at least one name in scenes")
    findings: list[Finding] = []
    for name, check, expected in _CHECKS:
        if not suite.broken:
            findings += _guarded(name, check, suite) or [Finding("ok", name, expected)]
    return findings


def _guarded(name: str, check: Callable[[Suite], list[Finding]], suite: Suite) -> list[Finding]:
    """Findings of one check; an agent that cannot be built for it is one."""
    try:
        return check(suite)
    except BuildError as error:
        suite.broken = name == "build"
        return [failure(name, error.__cause__ or error, "build", "an agent")]


def _builds(suite: Suite) -> list[Finding]:
    agent: object = suite.agent()
    missing = [name for name in ("reset", "act") if not callable(getattr(agent, name, None))]
    if not missing:
        return []
    suite.broken = True
    got = f"{type(agent).__name__} without {' and '.join(missing)}"
    return [Finding("error", "build", got, "reset(task) and act(observation)", "build", "write them")]


def _travels(suite: Suite) -> list[Finding]:
    try:
        size = len(pickle.dumps(suite.make))
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        advice = "give a function of a module; `mtp-bench` itself sends the folder's path"
        return [Finding("warning", "travels", f"cannot be pickled ({text})", "a path or a name", "", advice)]
    if size > LARGEST_PICKLE:
        advice = "load weights in build, not before it"
        return [Finding("warning", "travels", f"pickles as {size >> 20} MiB", "a path or a name", "", advice)]
    return []


def _contract(suite: Suite) -> list[Finding]:
    """Play all scenes with one agent, and look at each answer."""
    agent = suite.agent()
    total: list[SceneScore] = []
    for scene in suite.scenes:
        played = play(agent, suite.env, scene, suite.seed)
        suite.played.append(played)
        if played.failure is not None:
            suite.broken = True
            return played.findings("contract")
        total.append(score_scene(suite.env.scene, suite.env.rollout(), suite.env.card))
    suite.score = mean_error(total)
    found = _merged([finding for played in suite.played for finding in played.findings("contract")])
    return found if any(finding.level == "error" for finding in found) else found + _silent(suite)


def _merged(findings: list[Finding]) -> list[Finding]:
    """One finding per field and reason: the first; other scenes would repeat it."""
    first: dict[str, Finding] = {}
    for finding in findings:
        first.setdefault(finding.got.split(" in ")[0], finding)
    return list(first.values())


def _silent(suite: Suite) -> list[Finding]:
    answers = [answer for played in suite.played for answer in played.answers]
    found = []
    for what, said in (("track", "track_id"), ("forecast", "object_class")):
        if not any(len(getattr(answer, said)) for answer in answers):
            expected = f"{what}s of what is detected"
            where = ", ".join(f"scene {scene}" for scene in suite.scenes)
            found.append(Finding("warning", "contract", f"no sound {what} in any frame", expected, where))
    return found


def _deterministic(suite: Suite) -> list[Finding]:
    again = play(suite.agent(), suite.env, suite.scenes[0], suite.seed)
    if again.failure is not None:
        return again.findings("determinism")
    where = first_difference(suite.played[0], again)
    if where:
        suite.deterministic = False
        advice = "draw from np.random.default_rng(task.seed), made in reset"
        got, expected = "a second agent with the same seed answers otherwise", "the same answers"
        return [Finding("error", "determinism", got, expected, where, advice)]
    with another_clock():
        later = play(suite.agent(), suite.env, suite.scenes[0], suite.seed)
    where = first_difference(suite.played[0], later)
    if where:
        got, advice = "answers depend on the clock", "count steps, not seconds: a run cannot be repeated otherwise"
        return [Finding("warning", "determinism", got, "the same answers", where, advice)]
    return []


def _forgets(suite: Suite) -> list[Finding]:
    agent, first = suite.agent(), suite.scenes[0]
    for scene in suite.scenes[1:] or suite.scenes:
        before = play(agent, suite.env, scene, suite.seed)
        if before.failure is not None:
            return before.findings("reset")
    played = play(agent, suite.env, first, suite.seed)
    if played.failure is not None:
        return played.findings("reset")
    where = first_difference(suite.played[0], played)
    if not where or not suite.deterministic:
        return []
    advice = "make everything that changes anew in reset"
    got, expected = "after another scene the answers differ", "the answers of an agent that saw nothing before"
    return [Finding("error", "reset", got, expected, where, advice)]


def _leaves_observations(suite: Suite) -> list[Finding]:
    found = []
    written = next((played.written for played in suite.played if played.written), "")
    if written:
        got, advice = "writes into the observation", "copy what you change"
        found.append(Finding("warning", "observations", got, "an observation that is left as it was", written, advice))
    scribbled = play(suite.agent(), suite.env, suite.scenes[0], suite.seed, scribble=True)
    if scribbled.failure is not None:
        return [*found, *scribbled.findings("observations")]
    where = first_difference(suite.played[0], scribbled)
    if where and suite.deterministic:
        got = "answers change when an earlier observation is overwritten"
        advice = "copy what you keep: the arrays may be used again for the next frame"
        found.append(Finding("error", "observations", got, "no references kept", where, advice))
    return found


# name, check, what is shown when it finds nothing
_CHECKS: tuple[tuple[str, Callable[[Suite], list[Finding]], str], ...] = (
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
