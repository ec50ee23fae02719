"""How long a frame takes with H hypotheses, by stage: timed apart from all other runs, on one core."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..agent import Agent
from ..env.environment import MTPEnv
from ..running.run import agent_task, run_scene
from ..running.settings import Setting
from ..submission.loader import load_submission
from ..types import Action, Observation, Task
from .runs import Bench, shown_of

FRAMES = 120  # scenes are timed until they have so many, per number of hypotheses
REPEATS = 2  # the faster counts


@dataclass(frozen=True)
class Speed:
    """What a frame takes, mean over frames."""

    hypotheses: int
    tracking: float | None  # ms; None where the agent does not tell
    prediction: float | None  # ms, with sampling and presence
    whole: float  # ms
    frames: int


@dataclass
class _Clocked:
    """An agent, and the sum of what its stages say that they took."""

    agent: Agent
    stages: dict[str, float] = field(default_factory=dict)  # s

    def reset(self, task: Task) -> None:
        self.agent.reset(task)

    def act(self, observation: Observation) -> Action:
        action = self.agent.act(observation)
        for stage, seconds in getattr(self.agent, "seconds", {}).items():
            self.stages[stage] = self.stages.get(stage, 0.0) + seconds
        return action


def speed_of(bench: Bench, setting: Setting) -> Speed:
    """What a frame of the first scenes takes an agent, in this process, after one scene to warm up."""
    keywords = {**bench.options.env_keywords, **shown_of(bench, setting), "evaluation": True}
    env = MTPEnv(bench.env_id, **keywords)
    agent = load_submission(setting.submission.path).build(agent_task(env, 0), **setting.parameters)
    run_scene(agent, env, bench.scenes[0], 0, setting.label)
    rounds = [_round(bench, agent, env, setting) for _ in range(REPEATS)]
    return min(rounds, key=lambda speed: speed.whole)


def _round(bench: Bench, agent: Agent, env: MTPEnv, setting: Setting) -> Speed:
    clocked, frames, seconds = _Clocked(agent), 0, 0.0
    for scene in bench.scenes:
        rollout = run_scene(clocked, env, scene, 0, setting.label)
        frames, seconds = frames + rollout.frames, seconds + float(rollout.seconds.sum())
        if frames >= FRAMES:
            break
    stages = {stage: 1e3 * spent / frames for stage, spent in clocked.stages.items()}
    return Speed(
        setting.hypotheses or 1, stages.get("tracking"), stages.get("prediction"), 1e3 * seconds / frames, frames
    )
