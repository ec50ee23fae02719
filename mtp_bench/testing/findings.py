"""What a check found."""

from __future__ import annotations

import importlib
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..errors import MtpBenchError, sentence

Level = Literal["ok", "warning", "error"]

_OWN = Path(__file__).resolve().parent  # frames of these files say nothing of the agent
_LOADERS = {_OWN.parent / "submission" / name for name in ("loader.py", "importing.py")}
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
    advice: str = ""  # what to do
    traceback: tuple[str, ...] = ()  # the last calls, innermost last: 'agent.py, line 12, in act: x = 1 / 0'

    def __str__(self) -> str:
        return f"{self.check}: {sentence(self.got, self.expected, self.where, self.advice)}"


class AgentError(Exception):
    """The agent could not be built or raised; ``finding`` says where, its check has no name yet."""

    def __init__(self, finding: Finding) -> None:
        self.finding = finding
        super().__init__(str(finding))


def failure(error: BaseException, where: str, expected: str) -> AgentError:
    """What the agent raised, with the lines of its code that led there.

    An error of this library says itself what was expected: ``expected`` is for all others.
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
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<frozen")
        and Path(frame.filename).resolve() not in _LOADERS
        and Path(frame.filename).resolve().parent != _OWN
    ]
    return tuple(
        f"{Path(frame.filename).name}, line {frame.lineno}, in {frame.name}: {frame.line}" for frame in frames[-_LINES:]
    )
