"""The agents of a recording."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ...errors import MtpBenchError, UnknownNameError
from ..replay import Replay
from .arrays import LEVELS, shown_hypotheses


@dataclass(frozen=True, eq=False)
class Shown:
    """One agent in a recording."""

    replay: Replay
    root: str  # prefix of its entities: "" or "agents/<name>/"
    number: int  # of the agents shown
    hypotheses: list[int]


def shown_agents(replays: Sequence[Replay], level: str) -> list[Shown]:
    """The agents of a recording and what is drawn of them; they must be of one scene and have names of their own."""
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    shown: list[Shown] = []
    for replay in replays:
        root = f"agents/{_name(replay.agent, [s.root for s in shown])}/" if len(replays) > 1 else ""
        hypotheses = [] if level == "off" else shown_hypotheses(replay, level)
        shown.append(Shown(replay, root, len(shown), hypotheses))
    return shown


def _name(agent: str, taken: Iterable[str]) -> str:
    """Part of an entity path; a second run of an agent gets a number."""
    base = re.sub(r"[^\w.-]", "_", agent) or "agent"
    roots = set(taken)
    names = (base if number == 1 else f"{base}-{number}" for number in itertools.count(1))
    return next(name for name in names if f"agents/{name}/" not in roots)
