"""Checks of an agent under other conditions: sizes, empty and full frames, other coordinates, time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..running.run import agent_task
from ..scoring import SceneScore, mean_error, score_scene
from .findings import Finding
from .made_up import extreme_frames
from .playing import play, play_made_up
from .suite import Suite

MOTION_TOLERANCE = 0.05  # of the score, for the rounding of forecasts and for draws along the axes
_FEW = 6  # frames that show whether other sizes work
_SMALL = {"detections": 4, "tracks": 3, "objects": 2, "hypotheses": 1, "samples": 1}
_MORE = {"detections": 9, "tracks": 7, "objects": 5, "hypotheses": 3, "samples": 2}


def other_sizes(suite: Suite) -> list[Finding]:
    """Whether it answers where the arrays are smaller or larger than the env's own."""
    task = suite.env.task
    found: list[Finding] = []
    for sizes in (_SMALL, {name: getattr(task, name) + more for name, more in _MORE.items()}):
        env = suite.other_env(**sizes)
        played = play(suite.agent(env), env, suite.scenes[0], suite.seed, _FEW)
        shown = ", ".join(f"{name} {value}" for name, value in sizes.items())
        news = [seen for (name, _), seen in played.problems.items() if name not in suite.faulty]
        wrong = [seen for seen in news if seen.problem.level == "error"]
        advice = "take every size from the task"
        if played.failure is not None:
            where = f"{played.failure.where}; {shown}"
            found.append(replace(played.failure, check="sizes", where=where, advice=advice))
        elif wrong:
            got = "; ".join(f"{seen.problem.field} {seen.problem.reason}" for seen in wrong)
            where = f"{wrong[0].where}; {shown}"
            found.append(Finding("error", "sizes", got, "answers of the task's sizes", where, advice))
    return found


def extremes(suite: Suite) -> list[Finding]:
    """Whether it answers frames without detections and frames full of them."""
    task = agent_task(suite.env, suite.seed)
    played = play_made_up(suite.agent(), task, extreme_frames(task))
    if played.failure is not None:
        return played.findings("extremes")
    played.problems = {key: seen for key, seen in played.problems.items() if key[0] not in suite.faulty}
    return played.findings("extremes")


def unmoved(suite: Suite) -> list[Finding]:
    """Whether it scores alike where the coordinates are turned and shifted: a lookup table does not."""
    env = suite.other_env(rigid_motion=True)
    total: list[SceneScore] = []
    for scene in suite.scenes:
        played = play(suite.agent(env), env, scene, suite.seed, turn=1)
        if played.failure is not None:
            return played.findings("rigid motion")
        total.append(score_scene(env.scene, env.rollout(), env.card))
    moved = mean_error(total)
    if moved is None or suite.score is None:  # no targets
        return []
    if abs(moved - suite.score) <= MOTION_TOLERANCE * max(moved, suite.score):
        return []
    got = f"the error is {moved:.3f} m with turned and shifted coordinates, {suite.score:.3f} m without"
    where = ", ".join(f"scene {scene}" for scene in suite.scenes)
    advice = "nothing may depend on where the scene lies or on the axes"
    return [Finding("error", "rigid motion", got, f"the same within {MOTION_TOLERANCE:.0%}", where, advice)]


def latency(suite: Suite) -> list[Finding]:
    """How long it takes per frame, for whoever reads it: always ok."""
    seconds = np.concatenate([played.seconds[1:] for played in suite.played])
    if not len(seconds):
        return []
    p50, p95 = 1000.0 * np.percentile(seconds, [50, 95])
    first = 1000.0 * max(played.seconds[0] for played in suite.played)
    text = f"{p50:.1f} ms per frame (p50), {p95:.1f} ms (p95); slowest first frame {first:.0f} ms"
    return [Finding("ok", "latency", text)]
