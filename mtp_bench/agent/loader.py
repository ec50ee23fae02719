"""Load a submission: a folder with ``submission.toml``, the code of an agent and its weights.

The baselines have the same form and are loaded by the same code; see ``baselines/README.md``. Objects and functions of
the calling program can stand in place of a folder.
"""

import inspect
import os
import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core import (
    MtpBenchError,
    SubmissionError,
    UnknownNameError,
    baseline_names,
    bundled,
    clean_text,
    require_known,
)
from .manifest import MANIFEST, MOST_NAME, Manifest, Role, read_manifest
from .submission_files import digest_of, files_of, import_from

if TYPE_CHECKING:
    from ..core import Task
    from .protocols import Agent

ON_SCORED = "trained on scored scenes"  # ends the notes of `Submission.note_on`
_EXPECTED = (
    "an agent with reset(task) and act(observation), a function build(task) that returns one, the name of a baseline "
    f"or a folder with {MANIFEST}"
)


class Submission(Manifest):
    """A submission: its folder and its manifest, whose keys are fields such as ``name`` and ``parameters``.

    ``baselines/README.md`` explains the keys. The code is imported when an agent is built.
    """

    path: Path  # absolute

    @cached_property
    def digest(self) -> str:
        """Sha256 over names and contents of all files of the folder; see `contents`."""
        return digest_of(self.path, files_of(self.path))

    def note_on(self, env_id: str) -> str | None:
        """Note on the parts that were trained on the scenes that an env scores; None without any."""
        parts = self.trained_on_scored.get(env_id)
        return None if parts is None else f"{parts} {ON_SCORED}"

    def build(self, task: "Task", **overrides: Any) -> "Agent":
        """A new agent for ``task``; ``overrides`` win over the parameters of the manifest.

        Raises SubmissionError if the code cannot be imported or the built object is not an agent, and UnknownNameError
        for a parameter that the build function does not take.
        """
        function = self._function()
        parameters = {**self.parameters, **overrides}
        _check_parameters(self.name, function, parameters)
        agent: Agent = function(task, **parameters)
        missing = missing_methods(agent)
        if missing:
            raise SubmissionError(
                f"{self.name}: {self.agent} returned {type(agent).__name__!r} without {' and '.join(missing)}, "
                "expected an agent with reset(task) and act(observation)"
            )
        return agent

    def require_copy(self) -> None:
        """Raise MtpBenchError unless other processes can make its agents."""

    def factory(self, parameters: dict[str, Any]) -> "Callable[[Task], Agent]":
        """A function that makes agents of this submission in any process."""
        return SubmissionFactory(str(self.path), parameters)

    def _function(self) -> Callable[..., Any]:
        module_name, name = self.agent.split(":")
        module = import_from(self.path, module_name, self.name)
        function = getattr(module, name, None)
        if not callable(function):
            names = [
                key
                for key, value in vars(module).items()
                if callable(value) and not key.startswith("_")
            ]
            file = f"{self.path.name}/{module_name}.py"
            raise UnknownNameError(
                f"function of {file}",
                name,
                names,
                f"the name behind ':' in agent of {MANIFEST}",
            )
        return function  # type: ignore[no-any-return]


@dataclass(frozen=True)
class SubmissionFactory:
    """Makes agents of one submission in any process: it pickles as a path, and the code is imported on first use."""

    path: str
    parameters: dict[str, Any] = field(default_factory=dict)

    def __call__(self, task: "Task") -> "Agent":
        """A new agent for ``task``."""
        return load_submission(self.path).build(
            task, **deepcopy(self.parameters)
        )  # an agent may change its own


def load_submission(name: str | Path) -> Submission:
    """Read the submission in folder ``name``, or the baseline of that name.

    Raises UnknownNameError for a name that no baseline has, SubmissionError for another path or a manifest's wrong key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise SubmissionError(
            f"the submission is {name!r}, expected its folder or the name of a baseline"
        )
    path = _find(name)
    return Submission.model_construct(path=path, **dict(read_manifest(path)))


@cache
def controls() -> dict[Role, str]:
    """Names of the shipped baselines that have a role in comparisons, by the role that their manifest states."""
    submissions = [load_submission(name) for name in baseline_names()]
    return {
        each.compare.role: each.name
        for each in submissions
        if each.compare.role is not None
    }


def _find(name: str | Path) -> Path:
    if str(name) in baseline_names():
        return bundled("baselines") / str(name)
    path = Path(name)
    path = path.parent if path.name == MANIFEST else path
    if (path / MANIFEST).exists():
        return path.resolve()
    if "," in str(name):
        raise SubmissionError(
            f"{str(name)!r} is not a submission: put blanks between agents, not commas"
        )
    if path.exists() or "/" in str(name) or os.sep in str(name):
        raise SubmissionError(
            f"{name} is not a submission, expected a folder with {MANIFEST}"
        )
    hint = f"name a baseline, or a folder with {MANIFEST}"
    raise UnknownNameError("submission", str(name), baseline_names(), hint)


def _check_parameters(
    name: str, function: Callable[..., Any], given: dict[str, Any]
) -> None:
    signature = list(inspect.signature(function).parameters.values())
    if not signature:
        raise SubmissionError(
            f"{name}: {function.__name__} takes no parameters, expected the task as its first parameter"
        )
    kinds = {parameter.kind for parameter in signature[1:]}
    if inspect.Parameter.VAR_KEYWORD in kinds:
        return
    known = {
        each.name: each
        for each in signature[1:]
        if each.kind is not each.VAR_POSITIONAL
    }
    hint = f"parameters stand in {MANIFEST} and behind the task in build"
    for key in given:
        require_known(f"parameter of {name}", key, known, hint)
    for key, parameter in known.items():
        if parameter.default is parameter.empty and key not in given:
            raise SubmissionError(
                f"{name}: parameter {key!r} has no value; give one in {MANIFEST} under [parameters]"
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
        own: dict[str, Any] = {
            "name": name or _name_of(given),
            "authors": (),
            "agent": _name_of(given),
            "path": Path(),
        }
        return cls.model_construct(**own, given=given, copied=copied, obstacle=obstacle)

    @cached_property
    def digest(self) -> str:
        """Empty: there are no files."""
        return ""

    def factory(self, parameters: dict[str, Any]) -> "Callable[[Task], Agent]":
        """A function that makes agents of it; in other processes only if it can be copied."""
        return partial(
            _make, self.name, self.copied, self.given if self.copied is None else None
        )

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
    return ObjectSubmission.model_construct(name=name, agent=name, given=given).build(
        task
    )


def submission_of(agent: object) -> Submission:
    """The submission of a folder, a name, an agent, a build function or a class; raises MtpBenchError for others."""
    if isinstance(agent, Submission):
        return agent
    if isinstance(agent, str | os.PathLike):
        return load_submission(Path(agent) if isinstance(agent, os.PathLike) else agent)
    if not _is_agent(agent) and not callable(agent):
        raise MtpBenchError(
            f"agent is of type {type(agent).__name__}, expected {_EXPECTED}"
        )
    return ObjectSubmission.of(agent)


def missing_methods(agent: object) -> list[str]:
    """Names of the methods of an agent that an object lacks."""
    return [
        name for name in ("reset", "act") if not callable(getattr(agent, name, None))
    ]


def _is_agent(given: object) -> bool:
    return not isinstance(given, type) and not missing_methods(given)


def _without_task(kind: type) -> Callable[..., Any]:
    """A class as a build function: it gets the task if its first parameter has no default."""
    first = next(iter(inspect.signature(kind).parameters.values()), None)
    needs_task = (
        first is not None
        and first.default is first.empty
        and first.kind is not first.VAR_KEYWORD
    )
    return kind if needs_task else lambda task: kind()


def _name_of(given: object) -> str:
    """The attribute ``name`` of an agent, the name of a function or class, else "agent"; one word."""
    own = getattr(given, "__name__", None) or getattr(given, "name", None)
    text = clean_text(own if isinstance(own, str) else type(given).__name__, MOST_NAME)
    return "agent" if text.startswith("<") else "_".join(text.split()) or "agent"
