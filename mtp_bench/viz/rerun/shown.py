"""Runs as a recording shows them: names, paths and the hypotheses of each agent."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import MtpBenchError, UnknownNameError
from ..focus import Focus
from ..framing import focuses_of
from ..replay import Incident, Replay

LEVELS = ("tracks", "top", "all")  # of detail, each with the content of the one before it
TOP_HYPOTHESES = 4


@dataclass(frozen=True, eq=False)
class ShownAgent:
    """One agent in a recording."""

    replay: Replay
    hypotheses: list[int]  # at least one
    name: str = ""  # empty for the only agent
    root: str = ""  # prefix of the paths of its entities
    shared: str = ""  # prefix of the paths of the map, the truth and the detections
    focus: Focus | None = None  # the event that the views look at

    @property
    def best(self) -> int:
        """The shown hypothesis that is best in most frames."""
        count = np.bincount(self.replay.answers.hypotheses.best, minlength=max(self.hypotheses) + 1)
        return max(self.hypotheses, key=lambda h: count[h])

    def titled(self, text: str) -> str:
        """``text`` for a view of this agent, with its name if there are several agents."""
        return f"{self.name}: {text}" if self.name else text


def shown_agents(replays: Sequence[Replay], level: str, at: Incident | None = None) -> list[ShownAgent]:
    """The runs of one scene, each with a name of its own; ``at``: an event of the first one, at which all look.

    The entities of the first run have no prefix, those of the others "agents/NAME/".
    """
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    focuses = [None] * len(replays) if at is None else focuses_of(replays, at)
    agents: list[ShownAgent] = []
    for replay, focus in zip(replays, focuses, strict=True):
        base = re.sub(r"[^\w.-]", "_", replay.agent) or "agent"
        names = [base, *(f"{base}-{number}" for number in range(2, len(replays) + 1))]
        name = next(each for each in names if each not in {agent.name for agent in agents})
        root = f"agents/{name}/" if agents else ""
        agents.append(ShownAgent(replay, _hypotheses(replay, level), name if len(replays) > 1 else "", root, "", focus))
    return agents


def _hypotheses(replay: Replay, level: str) -> list[int]:
    """The hypotheses of a level: all that ever hold a track, else the few that weigh most over the scene."""
    alive = np.flatnonzero(replay.answers.hypotheses.member.any(axis=0))
    if level != "all":
        weight = np.exp(replay.rollout.hypothesis_log_weight.astype(np.float64))[:, alive].sum(axis=0)
        alive = np.sort(alive[np.argsort(-weight, kind="stable")[:TOP_HYPOTHESES]])
    return alive.tolist() or [0]
