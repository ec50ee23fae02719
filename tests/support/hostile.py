"""Hostile submissions of a few lines: an honest agent, and one trick."""

import inspect
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mtp_bench import MTPEnv
from mtp_bench.cards import load_card
from mtp_bench.core import Rollout
from mtp_bench.judge import Limits, SceneRun, run_isolated
from mtp_bench.running.playing import run_scene
from mtp_bench.scoring import score_scene
from tests.support import small_scenes

SCENE, FRAMES = "0006", 7
QUICK = Limits(start=30.0, reset=10.0, first_frame=10.0, frame=5.0, scene=60.0, disk=8 << 20)
HURRIED = QUICK.model_copy(update={"frame": 0.4})  # for agents that are late on purpose
SLOW = 5 * HURRIED.frame  # s, far beyond the limit

MANIFEST = 'name = "hostile"\nauthors = ["N. N."]\nagent = "agent:build"\n'
HEAD = """
from __future__ import annotations
import ctypes, gc, os, pickle, socket, sys, time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
import numpy as np
from mtp_bench import Task

NDArray = dict  # for annotations
Action = dict
"""
TAIL = """
class Hostile(EchoAgent):
    def reset(self, task):
        super().reset(task)
        self.frame = 0

    def honest(self, observation):
        self.frame += 1
        return super().act(observation)

{trick}

def build(task, trick="", **parameters):
    methods = {}
    exec(trick, globals(), methods)
    for name, method in methods.items():
        setattr(Hostile, name, method)
    Hostile.given = parameters
    return Hostile()
"""
HONEST = """
def act(self, observation):
    return self.honest(observation)
"""


def submission(folder: Path, trick: str = HONEST) -> Path:
    """Folder of an agent whose method ``act`` is ``trick``; there, ``self.honest`` gives the honest answer."""
    folder.mkdir(exist_ok=True)
    parts = [inspect.getsource(part) for part in (small_scenes.empty_action, small_scenes.EchoAgent)]
    body = textwrap.indent(textwrap.dedent(trick), "    ")
    (folder / "agent.py").write_text("\n\n".join([HEAD, *parts, TAIL.replace("{trick}", body)]))
    (folder / "submission.toml").write_text(MANIFEST)
    return folder


@dataclass(frozen=True)
class Court:
    """The small card with its data, and where submissions are written."""

    card: str
    data: str
    folder: Path
    shared: Path | None = None  # a submission that takes its trick as a parameter, so that one fork server serves all

    def run(self, trick: str, limits: Limits = QUICK, scene: str = SCENE, **parameters: Any) -> SceneRun:
        if self.shared is None:
            submission(self.folder / "hostile", trick)
            return self.again(limits, scene, **parameters)
        given = {"trick": textwrap.dedent(trick), **parameters}
        return run_isolated(self.shared, self.card, {"data": self.data}, scene, parameters=given, limits=limits)

    def again(self, limits: Limits = QUICK, scene: str = SCENE, **parameters: Any) -> SceneRun:
        """The same submission, written by `run`, once more."""
        path = self.folder / "hostile"
        return run_isolated(path, self.card, {"data": self.data}, scene, parameters=parameters, limits=limits)

    def honest(self, scene: str = SCENE) -> Rollout:
        """Rollout of the agent without any trick, run in this process."""
        return run_scene(small_scenes.EchoAgent(), MTPEnv(self.card, self.data, evaluation=True), scene, 0)

    def error(self, rollout: Rollout) -> float:
        """The error of one scene at the fixed operating point, summed: what is uncovered costs, what is false too."""
        env = MTPEnv(self.card, self.data, evaluation=True)
        env.reset(options={"scene": rollout.scene})
        score = score_scene(env.scene, rollout, load_card(self.card))
        assert len(score), "a scene without targets shows nothing"
        return score.fixed_error
