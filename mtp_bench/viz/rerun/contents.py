"""Content of a recording: its agents, the hypotheses that are shown, and the event that the views look at."""

from __future__ import annotations

import itertools
import re
from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import MtpBenchError, UnknownNameError
from ...types import Ints
from ..answers import Answers
from ..focus import Focus
from ..replay import Incident, Replay

LEVELS = ("off", "tracks", "top", "all")  # of detail, each with the content of the one before it
TOP_HYPOTHESES = 4


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
    def focus_root(self) -> str:
        """Prefix of the paths of an event alone, empty for the first agent."""
        return self.root if self.number else ""

    @property
    def best(self) -> int | None:
        """The shown hypothesis that is best in most frames; None if none is shown."""
        count = np.bincount(self.replay.answers.hypotheses.best, minlength=max(self.hypotheses, default=0) + 1)
        return max(self.hypotheses, key=lambda h: count[h], default=None)

    def titled(self, text: str) -> str:
        """``text`` for a view of this agent, with its name if there are several agents."""
        return f"{self.name}: {text}" if self.name else text


@dataclass(frozen=True, eq=False)
class Contents:
    """The runs of a recording."""

    agents: list[ShownAgent]
    level: str  # of LEVELS
    at: Incident | None  # of the first run: the views look at it

    @cached_property
    def focuses(self) -> list[tuple[ShownAgent, Focus]]:
        """The event alone, as each run has it; empty without an event."""
        if self.at is None:
            return []
        return list(zip(self.agents, Focus.of_all([agent.replay for agent in self.agents], self.at), strict=True))


def contents_of(replays: Sequence[Replay], level: str, at: Incident | None = None) -> Contents:
    """Content of a recording of runs of one scene; each agent gets a name of its own."""
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    agents: list[ShownAgent] = []
    for replay in replays:
        name = _name(replay.agent, {agent.name for agent in agents}) if len(replays) > 1 else ""
        agents.append(ShownAgent(replay, name, len(agents), _hypotheses(replay.answers, level)))
    return Contents(agents, level, at)


def _name(agent: str, taken: Container[str]) -> str:
    """Part of an entity path; a second run of an agent gets a number."""
    base = re.sub(r"[^\w.-]", "_", agent) or "agent"
    names = itertools.chain([base], (f"{base}-{number}" for number in itertools.count(2)))
    return next(name for name in names if name not in taken)


def _hypotheses(answers: Answers, level: str) -> list[int]:
    """The hypotheses of a level: all, else the few that weigh most over the scene."""
    alive = np.flatnonzero(answers.hypotheses.member.any(axis=0))
    if level == "all":
        return [int(h) for h in alive]
    weight = np.exp(answers.rollout.hypothesis_log_weight.astype(np.float64))[:, alive].sum(axis=0)
    heaviest = alive[np.argsort(-weight, kind="stable")[:TOP_HYPOTHESES]]
    return [] if level == "off" else sorted(int(h) for h in heaviest)


def box_counts(replay: Replay) -> dict[str, Ints]:
    """The `Replay.counts` that are known: without FP unless the truth is complete."""
    return {name: count for name, count in replay.counts.items() if name != "FP" or replay.scene.truth_complete}
