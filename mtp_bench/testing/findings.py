"""`Finding`: one result of a check, with the calls that led to an exception of an agent."""

import importlib
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..errors import MtpBenchError, describe_problem

Level = Literal["ok", "warning", "error"]

_OWN = Path(__file__).resolve().parent  # frames of these files are not the agent's
_LOADERS = {_OWN.parent / "submission" / name for name in ("loader.py", "contents.py")}
_LOADERS |= {Path(importlib.__file__).resolve()}
_LINES = 4  # of a traceback


@dataclass(frozen=True)
class Finding:
    """One result of a check; ``str()`` is a sentence."""

    level: Level
    check: str  # short name of the check, such as "determinism"
    got: str
    expected: str = ""
    where: str = ""  # scene, frame, field
    advice: str = ""
    traceback: tuple[str, ...] = ()  # the last calls, innermost last: 'agent.py, line 12, in act: x = 1 / 0'

    def __str__(self) -> str:
        return f"{self.check}: {describe_problem(self.got, self.expected, self.where, self.advice)}"


class AgentError(Exception):
    """The agent could not be built or raised; the check of its ``finding`` is not named yet."""

    def __init__(self, finding: Finding) -> None:
        self.finding = finding
        super().__init__(str(finding))


def failure(error: BaseException, where: str, expected: str) -> AgentError:
    """Error for an exception of the agent, with the lines of its code that led there.

    Errors of this library state themselves what was expected; ``expected`` is for all others.
    """
    root = error
    while isinstance(root, MtpBenchError) and root.__cause__ is not None:
        root = root.__cause__
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, MtpBenchError):
        text, expected = str(error), ""
    lines = _calls(root)
    return AgentError(Finding("error", "", text, expected, where, "see the lines of its code" if lines else "", lines))


def _calls(error: BaseException) -> tuple[str, ...]:
    """The last calls of an exception in the agent's code."""
    lines = []
    for frame in traceback.extract_tb(error.__traceback__):
        path = Path(frame.filename).resolve()
        if not (frame.filename.startswith("<frozen") or path in _LOADERS or path.parent == _OWN):
            lines.append(f"{path.name}, line {frame.lineno}, in {frame.name}: {frame.line}")
    return tuple(lines[-_LINES:])
