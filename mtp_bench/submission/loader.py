"""Load a submission: a folder with ``submission.toml``, the code of an agent and its weights.

The baselines have the same form and are loaded by the same code; see ``baselines/README.md``.
"""

import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._bundle import baseline_names, bundled
from ..errors import SubmissionError, UnknownNameError, require_known
from .contents import digest_of, files_of, import_from
from .manifest import MANIFEST, Manifest, Role, read_manifest

if TYPE_CHECKING:
    from ..agent import Agent
    from ..types import Task

ON_SCORED = "trained on scored scenes"  # ends the notes of `Submission.note_on`


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
        missing = [name for name in ("reset", "act") if not callable(getattr(agent, name, None))]
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
            names = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            file = f"{self.path.name}/{module_name}.py"
            raise UnknownNameError(f"function of {file}", name, names, f"the name behind ':' in agent of {MANIFEST}")
        return function  # type: ignore[no-any-return]


@dataclass(frozen=True)
class SubmissionFactory:
    """Makes agents of one submission in any process: it pickles as a path, and the code is imported on first use."""

    path: str
    parameters: dict[str, Any] = field(default_factory=dict)

    def __call__(self, task: "Task") -> "Agent":
        """A new agent for ``task``."""
        return load_submission(self.path).build(task, **self.parameters)


def load_submission(name: str | Path) -> Submission:
    """Read the submission in folder ``name``, or the baseline of that name.

    Raises UnknownNameError for a name that no baseline has, SubmissionError for another path or a manifest's wrong key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise SubmissionError(f"the submission is {name!r}, expected its folder or the name of a baseline")
    path = _find(name)
    return Submission.model_construct(path=path, **dict(read_manifest(path)))


@cache
def controls() -> dict[Role, str]:
    """Names of the shipped baselines that have a role in comparisons, by the role that their manifest states."""
    submissions = [load_submission(name) for name in baseline_names()]
    return {each.compare.role: each.name for each in submissions if each.compare.role is not None}


def _find(name: str | Path) -> Path:
    if str(name) in baseline_names():
        return bundled("baselines") / str(name)
    path = Path(name)
    path = path.parent if path.name == MANIFEST else path
    if (path / MANIFEST).exists():
        return path.resolve()
    if "," in str(name):
        raise SubmissionError(f"{str(name)!r} is not a submission: put blanks between agents, not commas")
    if path.exists() or "/" in str(name) or os.sep in str(name):
        raise SubmissionError(f"{name} is not a submission, expected a folder with {MANIFEST}")
    hint = f"name a baseline, or a folder with {MANIFEST}"
    raise UnknownNameError("submission", str(name), baseline_names(), hint)


def _check_parameters(name: str, function: Callable[..., Any], given: dict[str, Any]) -> None:
    signature = list(inspect.signature(function).parameters.values())
    if not signature:
        raise SubmissionError(
            f"{name}: {function.__name__} takes no parameters, expected the task as its first parameter"
        )
    kinds = {parameter.kind for parameter in signature[1:]}
    if inspect.Parameter.VAR_KEYWORD in kinds:
        return
    known = {each.name: each for each in signature[1:] if each.kind is not each.VAR_POSITIONAL}
    hint = f"parameters stand in {MANIFEST} and behind the task in build"
    for key in given:
        require_known(f"parameter of {name}", key, known, hint)
    for key, parameter in known.items():
        if parameter.default is parameter.empty and key not in given:
            raise SubmissionError(f"{name}: parameter {key!r} has no value; give one in {MANIFEST} under [parameters]")
