"""Limits of an agent process, and the finished scene."""

from dataclasses import dataclass
from typing import Literal

from ...core import Rollout, Section

SandboxBackend = Literal["bubblewrap", "none"]  # "none": agents run unsandboxed


@dataclass(frozen=True)
class Limits:
    """Bounds of one agent on one scene.

    All times are measured outside the agent's process.
    """

    start: float = 120.0  # s until the agent is built (imports, compilation)
    reset: float = 60.0  # s for reset(task)
    first_frame: float = 60.0  # s for the first answer (compilation)
    frame: float = 5.0  # s for any other answer; a later one ends the scene
    scene: float = 1800.0  # s in total
    memory: int = 8 << 30  # bytes of address space of each of the agent's processes
    # bytes it may write: in all where it has a file system of its own, else per file
    disk: int = 64 << 20
    answer: int = 64 << 20  # bytes of one answer


class Isolation(Section):
    """Sandbox of an agent's process, see ``SECURITY.md``.

    In a record it is the weakest over all runs.
    """

    mechanism: SandboxBackend
    # what bounds the memory of all its processes together
    memory: Literal["cgroup", "watch"]

    @property
    def sandboxed(self) -> bool:
        """True if it could not reach truth, network and other processes.

        Required for the level "re-run".
        """
        return self.mechanism != "none"


UNSANDBOXED = Isolation(mechanism="none", memory="watch")


@dataclass(frozen=True, eq=False)
class SceneRun:
    """A finished scene, answered by an agent in a process of its own."""

    rollout: Rollout  # frames without an answer have no rows
    seal: str  # hex; hash chain over all answers in order
    # "finished", "crashed", "hung" or "rejected" (it broke the rules of the gateway)
    status: str
    reason: str  # empty, or one sentence
    # frames unanswered because the answer was malformed: too large, other shapes, no
    # arrays, not finite
    malformed: int
    peak_memory: int  # resident memory of the agent's process, bytes; 0 if unknown
    started: float  # s until the agent was built
    isolation: Isolation = UNSANDBOXED
    scene_digest: str = ""  # hex; of the data that the agent was shown
