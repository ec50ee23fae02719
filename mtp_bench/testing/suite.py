"""What all checks of one agent share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..agent import Agent
from ..env.environment import MTPEnv
from ..running.run import MakeAgent, agent_task
from .playing import Played


class BuildError(Exception):
    """The agent could not be built; the cause says why."""


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
    broken: bool = False  # it cannot be built or fails on a scene: every check would say the same
    deterministic: bool = True

    def agent(self, env: MTPEnv | None = None) -> Agent:
        """A new agent for the task of ``env``, by default the env of the suite; raises BuildError."""
        try:
            return self.make(agent_task(env or self.env, self.seed))
        except (Exception, SystemExit) as error:
            raise BuildError from error

    @property
    def faulty(self) -> set[str]:
        """Fields with problems that were found already: under other conditions they are the same."""
        return {name for played in self.played for name, _ in played.problems}

    def other_env(self, **changes: Any) -> MTPEnv:
        """The env of the suite with other keywords."""
        return MTPEnv(self.env_id, **{**self.keywords, **changes})
