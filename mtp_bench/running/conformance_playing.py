"""Passes of an agent over frames: its actions, their problems, what it overwrites."""

import importlib
import time
import traceback
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..agent import ActionProblem, Agent, check_action
from ..core import MtpBenchError, Observation, Task, describe_problem
from ..env import MTPEnv, RecordedAction, record_action
from .playing import MakeAgent, agent_task, derived_seed

# Yields description and observation of each step, then None; receives the action.
Steps = Generator[tuple[str, Observation] | None, Any, None]
Level = Literal["ok", "warning", "error"]

_FOLDER = Path(__file__).resolve().parent  # calls in these files are not the agent's
_AGENT_ROOM = _FOLDER.parent / "agent"
_LOADERS = {_AGENT_ROOM / name for name in ("loader.py", "submission_files.py")}
_LOADERS |= {Path(importlib.__file__).resolve()}
_TRACEBACK_LINES = 4


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    ``str()`` is a sentence.
    """

    level: Level
    check: str  # short name of the check, such as "determinism"
    got: str
    expected: str = ""
    where: str = ""  # scene, frame, field
    advice: str = ""
    # the last calls, innermost last: 'agent.py, line 12, in act: x = 1 / 0'
    traceback: tuple[str, ...] = ()

    def __str__(self) -> str:
        problem = describe_problem(self.got, self.expected, self.where, self.advice)
        return f"{self.check}: {problem}"


class AgentError(Exception):
    """The agent could not be built or raised.

    Its ``finding`` names no check yet.
    """

    def __init__(self, finding: Finding) -> None:
        self.finding = finding
        super().__init__(str(finding))


def failure(error: BaseException, where: str, expected: str) -> AgentError:
    """Return the error for an exception of the agent, with the lines of its code.

    Errors of this library state themselves what was expected; ``expected`` is for all
    others.
    """
    error_text = f"{type(error).__name__}: {error}"
    if isinstance(error, MtpBenchError):
        error_text = str(error)
        expected = ""
    # the agent's exception behind errors of this library
    cause = error
    while isinstance(cause, MtpBenchError) and cause.__cause__ is not None:
        cause = cause.__cause__
    code_lines = []
    for frame in traceback.extract_tb(cause.__traceback__):
        path = Path(frame.filename).resolve()
        is_frozen = frame.filename.startswith("<frozen")
        if not (is_frozen or path in _LOADERS or path.parent == _FOLDER):
            line = f"{path.name}, line {frame.lineno}, in {frame.name}: {frame.line}"
            code_lines.append(line)
    advice = "see the lines of its code" if code_lines else ""
    last_calls = tuple(code_lines[-_TRACEBACK_LINES:])
    return AgentError(
        Finding("error", "", error_text, expected, where, advice, last_calls)
    )


@dataclass
class ProblemCount:
    """One kind of problem over all frames."""

    problem: ActionProblem  # the first of its kind
    where: str
    rows: int = 0
    frames: int = 0

    def finding(self) -> Finding:
        """Return the problem, with its first row and how often it occurred."""
        problem = self.problem
        plural = "s" if self.frames > 1 else ""
        got = f"{problem.field}: {problem.reason} in {self.frames} frame{plural}"
        advice = problem.advice
        if problem.kind:  # rows, not the whole action, are wrong
            advice = f"the env takes such {problem.kind} out: they count as missing"
            if self.rows > 1:
                got += f", {self.rows} rows"
        return Finding(problem.level, "", got, problem.expected, self.where, advice)


ProblemCounts = dict[tuple[str, str], ProblemCount]  # by field and reason


@dataclass
class Played:
    """Actions of an agent in one pass, their problems and times."""

    where: str
    # in the frame of the observations
    actions: list[RecordedAction] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    problems: ProblemCounts = field(default_factory=dict)
    written: str = ""  # first observation that it wrote into; empty: none

    def note_action(self, action: object, task: Task, place: str) -> None:
        """Keep the sound part of an action, and the problems of the rest."""
        examined = check_action(action, task)
        self.actions.append(record_action(examined, task))
        for problem in examined.problems:
            where = place
            if problem.example:
                where += f", {problem.example}"
            kind = (problem.field, problem.reason)
            count = self.problems.setdefault(kind, ProblemCount(problem, where))
            count.rows += problem.rows
            count.frames += 1

    def note_written(
        self, copies: Observation, observation: Observation, place: str
    ) -> None:
        """Keep the name of the first entry that an agent changed or took out."""
        for entry_name, array in copies.items():
            if not self.written and not _is_same(array, observation.get(entry_name)):
                self.written = f"{place}, {entry_name}"


def play(
    agent: Agent,
    env: MTPEnv,
    scene: str,
    seed: int,
    scribble: bool = False,
    turn: int = 0,
) -> Played:
    """Run the agent on a ``scene`` of ``env``.

    The seeds of env and agent derive from ``seed``, that of the run. ``scribble``:
    overwrite every observation after the action, as an env with buffers would do.
    ``turn``: number of the rigid motion, in an env with rigid motions. Raises
    AgentError.
    """
    seed_name = f"{scene}|{turn}" if turn else scene
    env_seed = derived_seed(seed, seed_name, "env")
    first, _ = env.reset(seed=env_seed, options={"scene": scene})
    task = agent_task(env, seed, scene)
    return _play(agent, task, _episode(env, first), f"scene {scene}", scribble)


def play_made_up(
    agent: Agent, task: Task, frames: Iterable[tuple[str, Observation]]
) -> Played:
    """Run the agent on observations made up for a check.

    ``frames``: description and observation of each. Raises AgentError.
    """
    # a generator, as `_play` sends it the actions
    steps = (step for step in [*frames, None])
    return _play(agent, task, steps, "made-up scene", scribble=False)


def first_difference(a: Played, b: Played) -> str:
    """Return scene, frame and field where two passes differ first.

    Empty if equal.
    """
    frames = min(len(a.actions), len(b.actions))
    for t in range(frames):
        second_action = b.actions[t]
        for field_name, value in vars(a.actions[t]).items():
            if not np.array_equal(
                value, getattr(second_action, field_name), equal_nan=True
            ):
                return f"{a.where}, frame {t}, {field_name}"
    if len(a.actions) != len(b.actions):
        return f"{a.where}, frame {frames}"
    return ""


def _episode(env: MTPEnv, observation: Observation) -> Steps:
    """Step ``env``, whose reset gave ``observation``, to the end of the scene."""
    frame = 0
    is_over = False
    while not is_over:
        action = yield f"frame {frame}", observation
        observation, _, is_over, *_ = env.step(action)
        frame += 1
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
        entries = dict(observation)  # the agent may take some out
        copies = {name: array.copy() for name, array in entries.items()}
        try:
            begin = time.perf_counter()
            action = agent.act(observation)
            played.seconds.append(time.perf_counter() - begin)
        except (Exception, SystemExit) as error:
            raise failure(error, place, "an action") from error
        played.note_action(action, task, place)
        played.note_written(copies, observation, place)
        if scribble:
            action = _copied(action)
            for array in entries.values():
                if array.flags.writeable:  # an agent may have made it read-only
                    array[...] = 1
        step = steps.send(action)
    return played


def _copied(action: Any) -> Any:
    """Return an action without arrays of the observation."""
    if not isinstance(action, Mapping):
        return action
    copies = dict(action)
    for entry_name, value in copies.items():
        if isinstance(value, np.ndarray):
            copies[entry_name] = value.copy()
    return copies


def _is_same(array: np.ndarray, value: object) -> bool:
    is_float = array.dtype.kind == "f"
    return isinstance(value, np.ndarray) and np.array_equal(
        array, value, equal_nan=is_float
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
    passes: list[Played] = field(default_factory=list)  # the first pass of each scene
    score: float | None = None  # m, of the first pass
    # False: passes differ anyway, so no check can compare them
    deterministic: bool = True

    @property
    def where(self) -> str:
        """Names of the scenes, as text."""
        return ", ".join(f"scene {scene}" for scene in self.scenes)

    @property
    def problems(self) -> ProblemCounts:
        """Problems of the first passes, each where it first occurred."""
        problems: ProblemCounts = {}
        for played in self.passes:
            for kind, count in played.problems.items():
                problems.setdefault(kind, count)
        return problems

    def agent(self, env: MTPEnv | None = None) -> Agent:
        """Build an agent for the task of ``env``.

        None: the env of the suite. Raises AgentError.
        """
        try:
            return self.make(agent_task(env or self.env, self.seed, self.scenes[0]))
        except (Exception, SystemExit) as error:
            raise failure(error, "build", "an agent") from error

    def play(self, **keywords: Any) -> Played:
        """Run a new agent on the first scene.

        ``keywords``: as of `play`. Raises AgentError.
        """
        return play(self.agent(), self.env, self.scenes[0], self.seed, **keywords)
