"""What a recording holds: the agents, how much of each, and the event that its views look at."""

from __future__ import annotations

import itertools
import re
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import MtpBenchError, UnknownNameError
from ..replay import Incident, Replay
from .arrays import LEVELS, heaviest_hypotheses


@dataclass(frozen=True, eq=False)
class ShownAgent:
    """One agent in a recording."""

    replay: Replay
    name: str  # part of the paths of its entities; empty for the only agent
    number: int  # of the agents shown
    hypotheses: list[int]

    @property
    def root(self) -> str:
        """Prefix of the paths of its entities."""
        return f"agents/{self.name}/" if self.name else ""

    @property
    def best(self) -> int | None:
        """The shown hypothesis that is best in most frames; None where none is shown."""
        count = np.bincount(self.replay.said.hypotheses.best, minlength=max(self.hypotheses, default=0) + 1)
        return max(self.hypotheses, key=lambda h: count[h], default=None)

    def titled(self, text: str) -> str:
        """``text`` for a view of this agent, with its name where there are several."""
        return f"{self.name}: {text}" if self.name else text


@dataclass(frozen=True, eq=False)
class Contents:
    """The runs of a recording."""

    agents: list[ShownAgent]
    level: str  # of LEVELS
    at: Incident | None  # of the first run: what the views look at


def contents_of(replays: Sequence[Replay], level: str, at: Incident | None = None) -> Contents:
    """What is drawn of these runs; they must be of one scene, and get different names."""
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    agents: list[ShownAgent] = []
    for replay in replays:
        name = _name(replay.agent, {agent.name for agent in agents}) if len(replays) > 1 else ""
        hypotheses = [] if level == "off" else heaviest_hypotheses(replay.said, level)
        agents.append(ShownAgent(replay, name, len(agents), hypotheses))
    return Contents(agents, level, at)


def _name(agent: str, taken: Container[str]) -> str:
    """Part of an entity path; a second run of an agent gets a number."""
    base = re.sub(r"[^\w.-]", "_", agent) or "agent"
    names = itertools.chain([base], (f"{base}-{number}" for number in itertools.count(2)))
    return next(name for name in names if name not in taken)
