"""Submissions: folders with ``submission.toml``, code of an agent and weights.

The baselines have the same form and are loaded by the same code; see
``baselines/README.md``. Objects and functions of the calling program can stand in place
of a folder.
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
from .manifest import MANIFEST, MAX_NAME, Manifest, Role, read_manifest
from .submission_files import digest_of, files_of, import_from

if TYPE_CHECKING:
    from ..core import Task
    from .protocols import Agent

ON_SCORED = "trained on scored scenes"  # ends the notes of `Submission.note_on`
_EXPECTED = (
    "an agent with reset(task) and act(observation), a function build(task) that "
    f"returns one, the name of a baseline or a folder with {MANIFEST}"
)


class Submission(Manifest):
    """Folder of a submission, and its manifest, whose keys are fields.

    ``baselines/README.md`` explains the keys. The code is imported when an agent is
    built.
    """

    path: Path  # absolute

    @cached_property
    def digest(self) -> str:
        """Sha256 over names and contents of all files, see `submission_files`."""
        return digest_of(self.path, files_of(self.path))

    def note_on(self, env_id: str) -> str | None:
        """Return the note on parts trained on scenes that an env scores."""
        if env_id not in self.trained_on_scored:
            return None
        return f"{self.trained_on_scored[env_id]} {ON_SCORED}"

    def build(self, task: "Task", **overrides: Any) -> "Agent":
        """Build a new agent for ``task``.

        ``overrides`` win over the parameters of the manifest. Raises SubmissionError if
        the code cannot be imported or the built object is not an agent, and
        UnknownNameError for a parameter that the build function does not take.
        """
        function = self._function()
        parameters = {**self.parameters, **overrides}
        _check_parameters(self.name, function, parameters)
        agent: Agent = function(task, **parameters)
        missing = missing_methods(agent)
        if missing:
            raise SubmissionError(
                f"{self.name}: {self.agent} returned {type(agent).__name__!r} without "
                f"{' and '.join(missing)}, expected an agent with reset(task) and "
                "act(observation)"
            )
        return agent

    def require_copy(self) -> None:
        """Raise MtpBenchError unless other processes can make its agents.

        They can: they read the folder.
        """

    def factory(self, parameters: dict[str, Any]) -> "Callable[[Task], Agent]":
        """Return a function that makes agents in any process."""
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
    """Maker of agents of one submission in any process.

    It pickles as a path, and the code is imported on first use.
    """

    path: str
    parameters: dict[str, Any] = field(default_factory=dict)

    def __call__(self, task: "Task") -> "Agent":
        """Build a new agent for ``task``."""
        parameters = deepcopy(self.parameters)  # an agent may change its own
        return load_submission(self.path).build(task, **parameters)


def load_submission(name: str | Path) -> Submission:
    """Read the submission in folder ``name``, or the baseline of that name.

    Raises UnknownNameError for a name that no baseline has, SubmissionError for another
    path or a manifest's wrong key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise SubmissionError(
            f"the submission is {name!r}, expected its folder or the name of a baseline"
        )
    path = _find(name)
    return Submission.model_construct(path=path, **dict(read_manifest(path)))


@cache
def controls() -> dict[Role, str]:
    """Name the shipped baselines that have a role in comparisons, by role."""
    names: dict[Role, str] = {}
    for name in baseline_names():
        role = load_submission(name).compare.role
        if role is not None:
            names[role] = name
    return names


def _find(name: str | Path) -> Path:
    if str(name) in baseline_names():
        return bundled("baselines") / str(name)
    path = Path(name)
    if path.name == MANIFEST:
        path = path.parent
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
    name: str, function: Callable[..., Any], values: dict[str, Any]
) -> None:
    """Raise an error unless ``values`` fit the parameters of a build function.

    ``name`` of the submission. The first parameter is the task.
    """
    signature = list(inspect.signature(function).parameters.values())
    if not signature:
        raise SubmissionError(
            f"{name}: {function.__name__} takes no parameters, "
            "expected the task as its first parameter"
        )
    parameters: dict[str, inspect.Parameter] = {}
    for parameter in signature[1:]:
        if parameter.kind is parameter.VAR_KEYWORD:  # takes every name
            return
        if parameter.kind is not parameter.VAR_POSITIONAL:
            parameters[parameter.name] = parameter
    hint = f"parameters stand in {MANIFEST} and behind the task in build"
    for key in values:
        require_known(f"parameter of {name}", key, parameters, hint)
    for key, parameter in parameters.items():
        if parameter.default is parameter.empty and key not in values:
            raise SubmissionError(
                f"{name}: parameter {key!r} has no value; "
                f"give one in {MANIFEST} under [parameters]"
            )


class ObjectSubmission(Submission):
    """Agent, build function or class in place of a folder.

    Every scene gets a copy of it, so that what an object keeps from one scene to the
    next does not count; attributes of its class, globals and NumPy's global random
    numbers are not copied. An object that cannot be copied is used itself, in one
    process.
    """

    player: Any  # the agent, build function or class
    copied: bytes | None  # the pickled player; None: impossible
    obstacle: str = ""  # reason why it cannot be copied

    @classmethod
    def of(cls, player: object, name: str = "") -> "ObjectSubmission":
        """Return the submission of an agent object, function or class.

        ``name``: in place of its own.
        """
        import cloudpickle  # takes classes of scripts and notebooks too

        copied: bytes | None = None
        obstacle = ""
        try:
            copied = cloudpickle.dumps(player)
        except Exception as error:  # whatever the object raises
            obstacle = " ".join(f"{type(error).__name__}: {error}".split())
        return cls.model_construct(
            name=name or _name_of(player),
            authors=(),
            agent=_name_of(player),
            path=Path(),
            player=player,
            copied=copied,
            obstacle=obstacle,
        )

    @cached_property
    def digest(self) -> str:
        """Empty: there are no files."""
        return ""

    def factory(self, parameters: dict[str, Any]) -> "Callable[[Task], Agent]":
        """Return a function that makes agents of it.

        Other processes can call it only if the object can be copied.
        """
        if self.copied is None:
            return partial(_make_agent, self.name, self.player)
        return partial(_make_copy, self.name, self.copied)

    def require_copy(self) -> None:
        """Raise MtpBenchError unless it can be sent to another process."""
        if self.copied is None:
            raise MtpBenchError(
                f"agent {self.name!r} cannot be sent to other processes "
                f"({self.obstacle}): take jobs=1, or pass a function build(task) that "
                "makes it there"
            )

    def _function(self) -> Callable[..., Any]:
        if _is_agent(self.player):
            return lambda task: self.player
        if isinstance(self.player, type):
            return _with_task(self.player)
        return self.player  # type: ignore[no-any-return]


def _make_agent(name: str, player: object, task: "Task") -> "Agent":
    submission = ObjectSubmission.model_construct(name=name, agent=name, player=player)
    return submission.build(task)


def _make_copy(name: str, copied: bytes, task: "Task") -> "Agent":
    return _make_agent(name, pickle.loads(copied), task)


def submission_of(agent: object) -> Submission:
    """Return the submission of a folder, name, agent, build function or class.

    Raises MtpBenchError for others.
    """
    if isinstance(agent, Submission):
        return agent
    if isinstance(agent, str):
        return load_submission(agent)
    if isinstance(agent, os.PathLike):
        return load_submission(Path(agent))
    if not _is_agent(agent) and not callable(agent):
        raise MtpBenchError(
            f"agent is of type {type(agent).__name__}, expected {_EXPECTED}"
        )
    return ObjectSubmission.of(agent)


def missing_methods(agent: object) -> list[str]:
    """Name the methods of an agent that an object lacks."""
    return [
        name for name in ("reset", "act") if not callable(getattr(agent, name, None))
    ]


def _is_agent(player: object) -> bool:
    return not isinstance(player, type) and not missing_methods(player)


def _with_task(kind: type) -> Callable[..., Any]:
    """Return a class as a build function.

    The class gets the task if its first parameter has no default.
    """
    parameters = list(inspect.signature(kind).parameters.values())
    if parameters:
        first = parameters[0]
        if first.default is first.empty and first.kind is not first.VAR_KEYWORD:
            return kind
    return lambda task: kind()


def _name_of(player: object) -> str:
    """Name an agent, function or class in one word.

    "agent" without a name.
    """
    name = getattr(player, "__name__", None) or getattr(player, "name", None)
    if not isinstance(name, str):
        name = type(player).__name__
    text = clean_text(name, MAX_NAME)
    if text.startswith("<"):  # such as <lambda>
        return "agent"
    return "_".join(text.split()) or "agent"
