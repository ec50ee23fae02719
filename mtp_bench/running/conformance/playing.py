"""Passes of an agent over frames: its actions, their problems, and observations that it overwrites."""

import importlib
import time
import traceback
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...agent import ActionProblem, Agent, check_action
from ...core import MtpBenchError, Observation, Task, describe_problem
from ...env import MTPEnv, RecordedAction, record_action
from ..playing import MakeAgent, agent_task, derived_seed

Steps = Generator[
    tuple[str, Observation] | None, Any, None
]  # yields (description, observation), receives the action
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
    traceback: tuple[
        str, ...
    ] = ()  # the last calls, innermost last: 'agent.py, line 12, in act: x = 1 / 0'

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
    lines = []
    for frame in traceback.extract_tb(root.__traceback__):
        path = Path(frame.filename).resolve()
        if not (
            frame.filename.startswith("<frozen")
            or path in _LOADERS
            or path.parent == _OWN
        ):
            lines.append(
                f"{path.name}, line {frame.lineno}, in {frame.name}: {frame.line}"
            )
    advice, last = "see the lines of its code" if lines else "", tuple(lines[-_LINES:])
    return AgentError(Finding("error", "", text, expected, where, advice, last))


@dataclass
class ProblemCount:
    """One kind of problem over all frames."""

    problem: ActionProblem  # the first of its kind
    where: str
    rows: int = 0
    frames: int = 0

    def finding(self) -> Finding:
        """The problem, with its first row and how often it occurred."""
        problem = self.problem
        rows = f", {self.rows} rows" if problem.kind and self.rows > 1 else ""
        got = f"{problem.field}: {problem.reason} in {self.frames} frame{'s' * (self.frames > 1)}{rows}"
        advice = (
            f"the env takes such {problem.kind} out: they count as missing"
            if problem.kind
            else problem.advice
        )
        return Finding(problem.level, "", got, problem.expected, self.where, advice)


ProblemCounts = dict[tuple[str, str], ProblemCount]  # by field and reason


@dataclass
class Played:
    """Actions of an agent in one pass, their problems and times."""

    where: str
    actions: list[RecordedAction] = field(
        default_factory=list
    )  # in the frame of the observations
    seconds: list[float] = field(default_factory=list)
    problems: ProblemCounts = field(default_factory=dict)
    written: str = ""  # first observation that it wrote into; empty: none


def play(
    agent: Agent,
    env: MTPEnv,
    scene: str,
    seed: int,
    scribble: bool = False,
    turn: int = 0,
) -> Played:
    """Run the agent on a ``scene`` of ``env``; raises AgentError.

    ``seed``: of the run, from which those of env and agent are derived. ``scribble``: overwrite every observation after
    the action, as an env with buffers would do. ``turn``: number of the rigid motion, in an env with rigid motions.
    """
    place = "" if turn == 0 else f"|{turn}"
    first, _ = env.reset(
        seed=derived_seed(seed, scene + place, "env"), options={"scene": scene}
    )
    return _play(
        agent,
        agent_task(env, seed, scene),
        _episode(env, first),
        f"scene {scene}",
        scribble,
    )


def play_made_up(
    agent: Agent, task: Task, frames: Iterable[tuple[str, Observation]]
) -> Played:
    """Run the agent on observations made up for a check, each with its description; raises AgentError."""
    steps = (step for step in [*frames, None])
    return _play(agent, task, steps, "made-up scene", scribble=False)


def first_difference(a: Played, b: Played) -> str:
    """Scene, frame and field of the first difference of two passes; empty if they are equal."""
    for number, (x, y) in enumerate(zip(a.actions, b.actions, strict=False)):
        for name, value in vars(x).items():
            if not np.array_equal(value, getattr(y, name), equal_nan=True):
                return f"{a.where}, frame {number}, {name}"
    return (
        ""
        if len(a.actions) == len(b.actions)
        else f"{a.where}, frame {min(len(a.actions), len(b.actions))}"
    )


def _episode(env: MTPEnv, observation: Observation) -> Steps:
    number, over = 0, False
    while not over:
        observation, _, over, *_ = env.step((yield f"frame {number}", observation))
        number += 1
    yield None


def _play(agent: Agent, task: Task, steps: Steps, where: str, scribble: bool) -> Played:
    played = Played(where)
    try:
        agent.reset(task)
    except (Exception, SystemExit) as error:
        raise failure(error, f"{where}, reset", "a reset") from error
    step = next(steps)
    while step is not None:
        description, observation = step
        place = f"{where}, {description}"
        shown = dict(observation)  # the agent may take entries out
        before = {name: array.copy() for name, array in shown.items()}
        try:
            start = time.perf_counter()
            action = agent.act(observation)
            played.seconds.append(time.perf_counter() - start)
        except (Exception, SystemExit) as error:
            raise failure(error, place, "an action") from error
        _note_action(played, action, task, place)
        changed = [
            name
            for name, array in before.items()
            if not _same(array, observation.get(name))
        ]
        if changed and not played.written:
            played.written = f"{place}, {changed[0]}"
        if scribble:
            if isinstance(
                action, Mapping
            ):  # its arrays may be those of the observation
                action = {
                    k: value.copy() if isinstance(value, np.ndarray) else value
                    for k, value in action.items()
                }
            for array in shown.values():
                if array.flags.writeable:  # an agent may have made it read-only
                    array[...] = 1
        step = steps.send(action)
    return played


def _note_action(played: Played, action: object, task: Task, place: str) -> None:
    """Keep the sound part of the action and the problems of the rest."""
    checked = check_action(action, task)
    played.actions.append(record_action(checked, task))
    for problem in checked.problems:
        where = f"{place}, {problem.example}" if problem.example else place
        seen = played.problems.setdefault(
            (problem.field, problem.reason), ProblemCount(problem, where)
        )
        seen.rows += problem.rows
        seen.frames += 1


def _same(array: NDArray[Any], other: object) -> bool:
    return isinstance(other, np.ndarray) and np.array_equal(
        array, other, equal_nan=array.dtype.kind == "f"
    )


@dataclass
class Suite:
    """State shared by all checks of one agent."""

    make: MakeAgent
    env_id: str
    keywords: dict[str, Any]
    seed: int
    env: MTPEnv
    scenes: tuple[str, ...]
    passes: list[Played] = field(default_factory=list)  # the first pass over each scene
    score: float | None = None  # m, of the first pass
    deterministic: bool = True

    @property
    def where(self) -> str:
        """Names of the scenes, as text."""
        return ", ".join(f"scene {scene}" for scene in self.scenes)

    @property
    def problems(self) -> ProblemCounts:
        """Problems of the first passes, each where it first occurred."""
        first: ProblemCounts = {}
        for played in self.passes:
            first |= {
                key: seen for key, seen in played.problems.items() if key not in first
            }
        return first

    def agent(self, env: MTPEnv | None = None) -> Agent:
        """A new agent for the task of ``env``, by default the env of the suite; raises AgentError."""
        try:
            return self.make(agent_task(env or self.env, self.seed, self.scenes[0]))
        except (Exception, SystemExit) as error:
            raise failure(error, "build", "an agent") from error

    def play(self, **keywords: Any) -> Played:
        """Run a new agent on the first scene, keywords as for `play`; raises AgentError."""
        return play(self.agent(), self.env, self.scenes[0], self.seed, **keywords)
