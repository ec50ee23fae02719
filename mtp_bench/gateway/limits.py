"""What an agent may use, and what came of its scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..types import Rollout

Mechanism = Literal["bubblewrap", "namespaces", "none"]
PATIENCE = 10  # late answers in a row after which an agent counts as hung


@dataclass(frozen=True)
class Limits:
    """Bounds of one agent on one scene; generous but finite. All times are measured outside the agent's process."""

    start: float = 120.0  # s until the agent is built (imports, compilation)
    reset: float = 60.0  # s for reset(task)
    first_frame: float = 60.0  # s for the first answer (compilation)
    frame: float = 5.0  # s for any other answer; a later one leaves that frame unanswered
    scene: float = 1800.0  # s in all
    memory: int = 8 << 30  # bytes of address space of each of the agent's processes
    disk: int = 64 << 20  # bytes it may write: in all where it has a file system of its own, else per file
    answer: int = 64 << 20  # bytes of one answer
    cuda: bool = False  # it is given the graphics cards; its memory is then bounded for all its processes only


@dataclass(frozen=True)
class Isolation:
    """What held an agent: see ``SECURITY.md``."""

    mechanism: Mechanism = "none"  # who shut it in
    memory: Literal["cgroup", "watch"] = "watch"  # who bounds the memory of all its processes together

    @property
    def holds(self) -> bool:
        """Whether it was kept from truth, network and other processes; without that nothing can be confirmed."""
        return self.mechanism != "none"


@dataclass(frozen=True, eq=False)
class SceneRun:
    """One scene answered by an agent in a process of its own."""

    rollout: Rollout  # frames without an answer have no rows
    seal: str  # hex; the hash chain over all answers as they came, in order
    status: str  # "finished", "crashed", "hung" or "rejected" (broke the rules of the gateway)
    reason: str  # "" or one sentence for people
    late: int  # frames unanswered because the answer came too late
    malformed: int  # frames unanswered because the answer was none: too large, other shapes, no arrays, not finite
    peak_memory: int  # bytes resident, of the agent's process; 0 where the system does not tell
    started: float  # s until the agent was built
    isolation: Isolation = Isolation()
    scene_digest: str = ""  # hex; of the data that was shown
