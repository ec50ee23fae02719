"""Load a submission: a folder with ``submission.toml``, the code of an agent and its weights.

The baselines have the same form and are loaded by the same code; see ``baselines/README.md``.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .._bundle import baseline_names, bundled
from ..errors import SubmissionError, UnknownNameError
from ..files import file_digest
from .manifest import MANIFEST, CompareSection, read_manifest

if TYPE_CHECKING:
    from ..agent import Agent
    from ..types import Task


@dataclass(frozen=True)
class Submission:
    """A submission that was read, with its code not yet imported."""

    name: str
    authors: tuple[str, ...]
    path: Path  # absolute
    agent: str  # "module:function", relative to the folder
    description: str = ""
    training_data: tuple[str, ...] = ()  # what it was trained or fitted on, in words
    trained_on_scored: dict[str, str] = field(default_factory=dict)  # env id -> what was fitted on scenes it scores
    networks: tuple[str, ...] = ()  # whose weights it takes from those trained on the machine where it runs
    parameters: dict[str, Any] = field(default_factory=dict)
    compare: CompareSection = field(default_factory=CompareSection)

    @cached_property
    def digest(self) -> str:
        """The sha256 over names and contents of all files of the folder; ``__pycache__`` and ``.git`` do not count."""
        return _digest(self.path, submission_files(self.path))

    def note_on(self, env_id: str) -> str | None:
        """What tables and records say beside scores in an env: what was trained on the scenes that it scores."""
        what = self.trained_on_scored.get(env_id)
        return None if what is None else f"{what} trained on scored scenes"

    def build(self, task: Task, **overrides: Any) -> Agent:
        """A new agent for ``task``; ``overrides`` win over the parameters of the manifest.

        Raises SubmissionError if the code cannot be imported or what it builds is no agent, and UnknownNameError for
        a parameter that the build function does not take.
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

    def _function(self) -> Callable[..., Any]:
        module_name, name = self.agent.split(":")
        module = _import(self, module_name)
        function = getattr(module, name, None)
        if not callable(function):
            found = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            raise UnknownNameError(f"function of {self.path.name}/{module_name}.py", name, found, f"see {MANIFEST}")
        return function  # type: ignore[no-any-return]


@dataclass(frozen=True)
class SubmissionFactory:
    """Makes agents of one submission in any process: it pickles as a path, and the code is imported on first use."""

    path: str
    parameters: dict[str, Any] = field(default_factory=dict)

    def __call__(self, task: Task) -> Agent:
        """A new agent for ``task``."""
        return load_submission(self.path).build(task, **self.parameters)


def load_submission(name: str | Path) -> Submission:
    """Read the submission in folder ``name``, or the baseline of that name.

    Raises UnknownNameError if there is neither, and SubmissionError for a manifest that is wrong, naming the key.
    """
    path = _find(name)
    return Submission(path=path, **dict(read_manifest(path)))


def _find(name: str | Path) -> Path:
    baselines = baseline_names()
    if str(name) in baselines:
        return bundled("baselines") / str(name)
    path = Path(name)
    path = path.parent if path.name == MANIFEST else path
    if (path / MANIFEST).is_file():
        return path.resolve()
    if path.is_dir():
        raise SubmissionError(f"{path}: no {MANIFEST} in this folder")
    known = f"baselines are {', '.join(baselines) or 'not there'}; or give a folder with {MANIFEST}"
    raise UnknownNameError("submission", str(name), baselines, known)


def _check_parameters(name: str, function: Callable[..., Any], given: dict[str, Any]) -> None:
    _, *parameters = inspect.signature(function).parameters.values()  # the first one is the task
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return
    known = {parameter.name: parameter for parameter in parameters if parameter.kind is not parameter.VAR_POSITIONAL}
    for key in given:
        if key not in known:
            raise UnknownNameError(f"parameter of {name}", key, known)
    for key, parameter in known.items():
        if parameter.default is parameter.empty and key not in given:
            raise SubmissionError(f"{name}: parameter {key!r} has no value; give one in {MANIFEST} under [parameters]")


def _import(submission: Submission, module: str) -> ModuleType:
    """Import a module of the folder, as part of a package that no other submission shares.

    The package is named after path and source code: two submissions may have the same file names, code that was
    edited is imported anew, and modules of one folder import each other relatively (``from .model import Net``).
    """
    folder = submission.path
    sources = [path for path in submission_files(folder) if path.suffix == ".py"]
    package = f"mtp_submission_{hashlib.sha256(f'{folder} {_digest(folder, sources)}'.encode()).hexdigest()[:16]}"
    if package not in sys.modules:
        sys.modules[package] = ModuleType(package)
        sys.modules[package].__path__ = [str(folder)]
    importlib.invalidate_caches()
    try:
        return importlib.import_module(f"{package}.{module}")
    except (Exception, SystemExit) as error:
        hint = ""
        if isinstance(error, ModuleNotFoundError) and (folder / f"{error.name}.py").is_file():
            hint = f"; {error.name}.py is a file of the submission: write `from .{error.name} import ...`"
        raise SubmissionError(
            f"{submission.name}: importing {module}.py failed: {type(error).__name__}: {error}{hint}"
        ) from error


def submission_files(folder: Path) -> list[Path]:
    """Files of a submission, sorted by name; what tools leave behind is not part of it."""
    paths = [p for p in folder.rglob("*") if not {"__pycache__", ".git"} & set(p.relative_to(folder).parts)]
    for path in paths:
        if path.is_symlink() and path.is_dir():
            raise SubmissionError(f"{path} is a link to a folder; a submission holds its files itself: copy them")
    return sorted(path for path in paths if path.is_file())


def _digest(folder: Path, files: Iterable[Path]) -> str:
    total = hashlib.sha256()
    for path in files:
        total.update(f"{path.relative_to(folder).as_posix()}\0{file_digest(path)}\n".encode())
    return total.hexdigest()
