"""Limits of an agent process, and the finished scene."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from ...core import Rollout, Section

SandboxBackend = Literal["bubblewrap", "none"]  # "none": agents run unsandboxed
_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Bytes = Annotated[int, Field(gt=0, le=1 << 40)]


class Limits(Section):
    """Bounds of one agent on one scene.

    All times are measured outside the agent's process.
    """

    start: _Seconds = 120.0  # until the agent is built (imports, compilation)
    reset: _Seconds = 60.0  # for reset(task)
    first_frame: _Seconds = 60.0  # for the first answer (compilation)
    frame: _Seconds = 5.0  # for any other answer; a later one ends the scene
    scene: _Seconds = 1800.0  # in total
    memory: _Bytes = 8 << 30  # of address space of each of the agent's processes
    # it may write: in all where it has a file system of its own, else per file
    disk: _Bytes = 64 << 20
    answer: _Bytes = 64 << 20  # of one answer


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


PROCESS_ENDED = "the process "  # start of `SceneRun.reason` if the process ended
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
