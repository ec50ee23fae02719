"""What all checks of one agent share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..agent import Agent
from ..env.environment import MTPEnv
from ..running.run import MakeAgent, agent_task
from ..scoring import SceneScore, score_scene
from .findings import failure
from .playing import Played, Problems, play


@dataclass
class Suite:
    """What all checks of one agent share."""

    make: MakeAgent
    env_id: str
    keywords: dict[str, Any]
    seed: int
    env: MTPEnv
    scenes: tuple[str, ...]
    played: list[Played] = field(default_factory=list)  # the first pass, one per scene
    score: float | None = None  # m, of the first pass
    deterministic: bool = True

    @property
    def where(self) -> str:
        """The scenes in words."""
        return ", ".join(f"scene {scene}" for scene in self.scenes)

    @property
    def problems(self) -> Problems:
        """What was wrong in the first pass, with its first place: under other conditions it is the same."""
        first: Problems = {}
        for played in self.played:
            first |= {key: seen for key, seen in played.problems.items() if key not in first}
        return first

    def news(self, played: Played) -> Problems:
        """What is wrong in another pass with fields that were sound in the first one."""
        faulty = {name for name, _ in self.problems}
        return {key: seen for key, seen in played.problems.items() if key[0] not in faulty}

    def agent(self, env: MTPEnv | None = None) -> Agent:
        """A new agent for the task of ``env``, by default the env of the suite; raises AgentError."""
        try:
            return self.make(agent_task(env or self.env, self.seed))
        except (Exception, SystemExit) as error:
            raise failure(error, "build", "an agent") from error

    def play(self, **how: Any) -> Played:
        """Play the first scene with a new agent, ``how`` as for `play`; raises AgentError."""
        return play(self.agent(), self.env, self.scenes[0], self.seed, **how)

    def other_env(self, **changes: Any) -> MTPEnv:
        """The env of the suite with other keywords."""
        return MTPEnv(self.env_id, **{**self.keywords, **changes})


def score_of(env: MTPEnv) -> SceneScore:
    """Score of the episode that was played in ``env``."""
    return score_scene(env.scene, env.rollout(), env.card)
