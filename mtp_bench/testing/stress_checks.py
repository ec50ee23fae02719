"""Checks of an agent under other conditions: sizes, empty and full frames, other coordinates, time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..env.observation import Feed
from ..errors import MtpBenchError
from ..running.run import agent_task
from ..scoring import mean_plain_error
from ..types import Observation, Task, starts_of
from .findings import AgentError, Finding
from .playing import Suite, play, play_made_up, score_of

MOTION_TOLERANCE = 0.05  # of the score, for the rounding of forecasts and for draws along the axes
_FEW = 6  # frames that show whether other sizes work
_SMALL = {"detections": 4, "tracks": 3, "objects": 2, "hypotheses": 1, "samples": 1}
_MORE = {"detections": 9, "tracks": 7, "objects": 5, "hypotheses": 3, "samples": 2}
_APART = 6.0  # m between detections
_SPEED = 2.0  # m/s along x
_FULL = np.array([False, True, True, True, False, False, True])


def other_sizes(suite: Suite) -> Iterator[Finding]:
    """Whether it answers where the arrays are smaller or larger than the env's own."""
    task = suite.env.task
    for sizes in (_SMALL, {name: getattr(task, name) + more for name, more in _MORE.items()}):
        try:
            env = suite.other_env(**sizes)
        except MtpBenchError:  # the env is as large as one may be
            continue
        shown = ", ".join(f"{name} {value}" for name, value in sizes.items())
        advice = "take every size from the task"
        try:
            played = play(suite.agent(env), env, suite.scenes[0], suite.seed, _FEW)
        except AgentError as failed:
            yield replace(failed.finding, where=f"{failed.finding.where}; {shown}", advice=advice)
            continue
        wrong = [seen for seen in suite.news(played).values() if seen.problem.level == "error"]
        if wrong:
            got = "; ".join(f"{seen.problem.field} {seen.problem.reason}" for seen in wrong)
            where = f"{wrong[0].where}; {shown}"
            yield Finding("error", "", got, "answers of the task's sizes", where, advice)


def extremes(suite: Suite) -> Iterator[Finding]:
    """Whether it answers frames without detections and frames full of them."""
    task = agent_task(suite.env, suite.seed)
    played = play_made_up(suite.agent(), task, extreme_frames(task))
    for seen in suite.news(played).values():
        yield seen.finding()


def unmoved(suite: Suite) -> Iterator[Finding]:
    """Whether it scores alike where the coordinates are turned and shifted: a lookup table does not."""
    env = suite.other_env(rigid_motion=True)
    scores = []
    for scene in suite.scenes:
        play(suite.agent(env), env, scene, suite.seed, turn=1)
        scores.append(score_of(env))
    moved = mean_plain_error(scores)
    if moved is None or suite.score is None:  # no targets
        return
    if abs(moved - suite.score) > MOTION_TOLERANCE * max(moved, suite.score):
        got = f"the plain error is {moved:.3f} m with turned and shifted coordinates, {suite.score:.3f} m without"
        advice = "nothing may depend on where the scene lies or on the axes"
        yield Finding("error", "", got, f"the same within {MOTION_TOLERANCE:.0%}", suite.where, advice)


def latency(suite: Suite) -> Iterator[Finding]:
    """How long it takes per frame, for whoever reads it: always ok."""
    seconds = np.concatenate([played.seconds[1:] for played in suite.played])
    if len(seconds):
        p50, p95 = 1000.0 * np.percentile(seconds, [50, 95])
        first = 1000.0 * max(played.seconds[0] for played in suite.played)
        text = f"{p50:.1f} ms per frame (p50), {p95:.1f} ms (p95); slowest first frame {first:.0f} ms"
        yield Finding("ok", "", text)


def extreme_frames(task: Task) -> list[tuple[str, Observation]]:
    """Frames that no scene holds: none, a full one three times, none twice, and full again: [(what, observation)]."""
    frames, size = len(_FULL), task.detections
    frame, place = np.repeat(np.flatnonzero(_FULL), size), np.tile(np.arange(size), int(_FULL.sum()))
    side = int(np.ceil(np.sqrt(size)))
    box = np.tile([0.0, 0, 0, 0, 4.0, 1.8, 1.5], (len(place), 1))
    box[:, 0] = _APART * (place % side) + _SPEED * frame * task.dt
    box[:, 1] = _APART * (place // side)
    feed = Feed(
        start=starts_of(size * _FULL),
        size=size,
        box=box,
        velocity=np.tile([_SPEED if task.velocity else 0.0, 0.0], (len(place), 1)),
        score=np.ones(len(place)),
        class_id=place % len(task.classes),
        object_id=place if task.observe != "detections" else None,
        ego=np.zeros((frames, 4)),
        time=task.dt * np.arange(frames),
        dt=np.full(frames, task.dt),  # in the first frame too, as the env shows it
        dropped=np.zeros(frames, dtype=np.int64),
    )
    words = {True: "as many detections as fit", False: "no detections"}
    return [(f"frame {t} ({words[bool(_FULL[t])]})", feed.observe(t)) for t in range(frames)]
