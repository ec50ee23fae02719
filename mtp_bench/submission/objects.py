"""Agents that are objects or functions of the calling program, in place of a folder."""

import inspect
import pickle
from collections.abc import Callable
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import MtpBenchError
from ..files import clean_text
from .loader import Submission, load_submission
from .manifest import MANIFEST, MOST_NAME

if TYPE_CHECKING:
    from ..agent import Agent
    from ..types import Task

EXPECTED = (
    "an agent with reset(task) and act(observation), a function build(task) that returns one, the name of a baseline "
    f"or a folder with {MANIFEST}"
)


class ObjectSubmission(Submission):
    """An agent, a build function or a class in place of a folder.

    Every scene gets a copy of it, so that what an object keeps from one scene to the next does not count; attributes of
    its class, globals and NumPy's global random numbers are not copied. What cannot be is used itself, in one process.
    """

    given: Any
    copied: bytes | None  # pickled; None: impossible
    obstacle: str = ""  # that keeps it from being copied

    @classmethod
    def of(cls, given: object, name: str = "") -> "ObjectSubmission":
        """The submission of an agent object, function or class; ``name``: in place of its own."""
        import cloudpickle  # takes classes of scripts and notebooks too

        copied, obstacle = None, ""
        try:
            copied = cloudpickle.dumps(given)
        except Exception as error:  # whatever the object raises
            obstacle = " ".join(f"{type(error).__name__}: {error}".split())
        own: dict[str, Any] = {"name": name or _name_of(given), "authors": (), "agent": _name_of(given), "path": Path()}
        return cls.model_construct(**own, given=given, copied=copied, obstacle=obstacle)

    @property
    def digest(self) -> str:
        """Empty: there are no files."""
        return ""

    def factory(self, parameters: dict[str, Any]) -> "Callable[[Task], Agent]":
        """A function that makes agents of it; in other processes only if it can be copied."""
        return partial(_make, self.name, self.copied, self.given if self.copied is None else None)

    def require_copy(self) -> None:
        """Raise MtpBenchError unless it can be sent to another process."""
        if self.copied is None:
            raise MtpBenchError(
                f"agent {self.name!r} cannot be sent to other processes ({self.obstacle}): take jobs=1, or pass a "
                "function build(task) that makes it there"
            )

    def _function(self) -> Callable[..., Any]:
        if _is_agent(self.given):
            return lambda task: self.given
        return _without_task(self.given) if isinstance(self.given, type) else self.given


def _make(name: str, copied: bytes | None, given: object, task: "Task") -> "Agent":
    given = given if copied is None else pickle.loads(copied)
    return ObjectSubmission.model_construct(name=name, agent=name, given=given).build(task)


def submission_of(agent: object) -> Submission:
    """The submission of a folder, a name, an agent, a build function or a class; raises MtpBenchError for others."""
    if isinstance(agent, Submission):
        return agent
    if isinstance(agent, str | PathLike):
        return load_submission(Path(agent) if isinstance(agent, PathLike) else agent)
    if not _is_agent(agent) and not callable(agent):
        raise MtpBenchError(f"agent is of type {type(agent).__name__}, expected {EXPECTED}")
    return ObjectSubmission.of(agent)


def _is_agent(given: object) -> bool:
    return not isinstance(given, type) and all(callable(getattr(given, name, None)) for name in ("reset", "act"))


def _without_task(kind: type) -> Callable[..., Any]:
    """A class as a build function: it gets the task if its first parameter has no default."""
    first = next(iter(inspect.signature(kind).parameters.values()), None)
    needs_task = first is not None and first.default is first.empty and first.kind is not first.VAR_KEYWORD
    return kind if needs_task else lambda task: kind()


def _name_of(given: object) -> str:
    """The attribute ``name`` of an agent, the name of a function or class, else "agent"; one word."""
    own = getattr(given, "__name__", None) or getattr(given, "name", None)
    text = clean_text(own if isinstance(own, str) else type(given).__name__, MOST_NAME)
    return "agent" if text.startswith("<") else "_".join(text.split()) or "agent"
