"""One scene of questions and answers: what is late, malformed or against the rules, and the seal over all of it."""

from __future__ import annotations

import hashlib
import math
import secrets
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..files import clean_text
from ..types import ABSENT_BELOW, Rollout
from .channel import EndedError
from .limits import PATIENCE, Limits, SceneRun
from .process import AgentProcess, ExcessError, Message
from .wire import Arrays, WireError, arrays_of

Action = dict[str, Any]
_NOTHING = np.zeros(0)
MOST_WORDS = 2000  # characters of what an agent says of its end


class SceneOverError(Exception):
    """The scene is over for the agent."""

    def __init__(self, status: str, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, clean_text(reason, MOST_WORDS)


def answer_bytes(space: spaces.Space[Any], limits: Limits) -> int:
    """Bytes that an answer of this space may have."""
    assert isinstance(space, spaces.Dict)
    return min(limits.answer, sum(8 * math.prod(part.shape or ()) for part in space.spaces.values()))


class Exchange:
    """Questions to one agent and its answers; after the scene is over for it, there is none."""

    def __init__(self, process: AgentProcess, limits: Limits, space: spaces.Space[Any], seal: bytes) -> None:
        self._process, self._limits = process, limits
        assert isinstance(space, spaces.Dict)
        self._shapes = {name: tuple(part.shape or ()) for name, part in space.spaces.items()}
        self._most = answer_bytes(space, limits)
        self._frame = 0
        self._open: dict[int, str] = {}  # token of every frame whose answer may still come, too late
        self._silent = 0  # late answers in a row
        self._late = self._malformed = 0
        self._status, self._reason = "finished", ""
        self._started = 0.0
        self._begin = process.begun
        self._sealer = ThreadPoolExecutor(1)  # hashes an answer while the env makes the next frame
        self._seal = self._sealer.submit(bytes, seal)  # starts its thread before the agent could use up all there are

    def open(self, setup: dict[str, Any], task: dict[str, Any]) -> None:
        """Start the agent: built, then told the task."""
        try:
            self._process.send(setup)
            self._process.send({"kind": "build", "task": task})
            self._expect("built", self._limits.start)
            self._started = time.monotonic() - self._begin
            self._process.send({"kind": "reset", "task": task})
            self._expect("ready", self._limits.reset)
            self._look()
        except SceneOverError as end:
            self._status, self._reason = end.status, end.reason

    def ask(self, observation: Arrays) -> tuple[Action | None, float]:
        """The answer to one frame, None where none came in time, and the seconds that it took.

        One that is no answer comes back without fields, which the env takes for broken.
        """
        action: Action | None = None
        malformed = self._malformed
        begin = time.monotonic()
        spent = 0.0
        if self._status == "finished":
            try:
                action = self._answer(observation, begin)
                spent = time.monotonic() - begin
                self._look()
            except SceneOverError as end:
                self._status, self._reason, action = end.status, end.reason, None
        # One answer waits at most, so that a fast env does not pile them up.
        self._seal = self._sealer.submit(lengthened, self._seal.result(), self._frame, action)
        self._frame += 1
        broken = action is None and self._malformed > malformed
        return {} if broken else action, spent

    def result(self, rollout: Rollout) -> SceneRun:
        """What came of it."""
        self._sealer.shutdown()
        return SceneRun(
            rollout=rollout,
            seal=self._seal.result().hex(),
            status=self._status,
            reason=self._reason,
            late=self._late,
            malformed=self._malformed,
            peak_memory=self._process.peak_memory(),
            started=self._started,
            isolation=self._process.isolation,
        )

    def _answer(self, observation: Arrays, begin: float) -> Action | None:
        token = secrets.token_hex(8)  # must be repeated, so that no frame is answered before it was shown
        question = {"kind": "frame", "frame": self._frame, "token": token}
        self._process.send({**question, "fields": list(self._shapes), "most": self._most}, observation)
        limit = self._limits.first_frame if self._frame == 0 else self._limits.frame
        self._open[self._frame] = token
        message = self._wait_for_answer(begin + limit)
        if message is None:
            self._late += 1
            self._silent += 1
            if self._silent == PATIENCE or time.monotonic() >= self._begin + self._limits.scene:
                raise SceneOverError("hung", f"no answer in time since frame {self._frame + 1 - self._silent}")
            return None
        self._silent = 0
        return self._checked(message)

    def _wait_for_answer(self, deadline: float) -> Message | None:
        """The answer to this frame; those to earlier frames come too late and are dropped."""
        while True:
            message = self._message(min(deadline, self._begin + self._limits.scene))
            if message is None:
                return None
            frame, token = message[0].get("frame"), message[0].get("token")
            known = type(frame) is int and frame in self._open and self._open.pop(frame) == token
            if message[0].get("kind") != "answer" or not known:
                raise SceneOverError(
                    "rejected", "it sent what was not asked for: every frame is answered once, after it was shown"
                )
            if frame == self._frame:
                return message

    def _checked(self, message: Message) -> Action | None:
        header, body = message
        if "malformed" in header:
            self._malformed += 1
            return None
        try:
            arrays = arrays_of(header, body, self._shapes)
            fitting = {name: array for name, array in arrays.items() if array is not None}
            if len(fitting) == len(arrays) and _finite(fitting):
                for array in fitting.values():
                    array.flags.writeable = False  # it is hashed later
                return fitting
        except Exception as error:  # whatever reading an answer raises is the fault of who wrote it
            raise SceneOverError("rejected", f"it broke the wire format: {_said(error)}") from None
        self._malformed += 1
        return None

    def _expect(self, kind: str, seconds: float) -> None:
        message = self._message(min(time.monotonic() + seconds, self._begin + self._limits.scene))
        if message is None:
            raise SceneOverError("hung", f"not {kind} within {seconds:g} s")
        if message[0].get("kind") != kind:
            raise SceneOverError("rejected", f"it sent {str(message[0].get('kind'))[:20]!r}, expected {kind!r}")

    def _message(self, deadline: float) -> Message | None:
        """The next message; an error of the agent and the end of its process are the end of the scene."""
        try:
            message = self._process.receive(deadline)
        except EndedError:
            said = self._process.printed()
            reason = f"the process {self._process.exit_text()}" + (f"; it last said {said!r}" if said else "")
            raise SceneOverError("crashed", reason) from None
        except ExcessError as error:
            raise SceneOverError("rejected", str(error)) from None
        except Exception as error:
            raise SceneOverError("rejected", f"it broke the wire format: {_said(error)}") from None
        if message is not None and message[0].get("kind") == "error":
            raise SceneOverError("crashed", str(message[0].get("text")))
        return message

    def _look(self) -> None:
        if self._process.others():
            raise SceneOverError("rejected", f"it had started other processes at frame {self._frame}")


def lengthened(seal: bytes, frame: int, action: Action | None) -> bytes:
    """The chain with one more link: the hash before, the frame's number, and the answer or that there is none."""
    parts: list[bytes | memoryview] = [seal, frame.to_bytes(8, "little")]
    if action is None:
        parts.append(b"missed")  # the seals of the records that there are
    for name, array in sorted((action or {}).items()):
        parts += [f"|{name} {array.dtype.str} {list(array.shape)}|".encode(), array.data]
    # In one go: between many the thread would wait each time until the env lets it go on.
    return hashlib.sha256(b"".join(parts)).digest()


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, WireError) else f"{type(error).__name__}: {error}"


def _finite(action: Mapping[str, NDArray[Any]]) -> bool:
    """Whether every number of the tracks, hypotheses, objects and samples that are there is finite: else unanswered.

    ``action``: arrays of the right shapes; fields may be missing. Rows that are not valid may hold anything, as may
    samples whose log-weight says that they are absent; -inf is such a log-weight, NaN and +inf are none.
    """
    weight, forecast = _claimed(action, "forecast_log_weight", "object"), _claimed(action, "forecast", "object")
    if forecast.ndim > 1 and weight.shape == forecast.shape[:2]:  # else a field is missing: every sample counts
        forecast = forecast[weight >= ABSENT_BELOW]
    numbers = (_claimed(action, "track_box", "track"), _claimed(action, "object_box", "object"), forecast)
    weights = (weight, action.get("hypothesis_log_weight", _NOTHING))
    return all(np.isfinite(part).all() for part in numbers) and all((part < np.inf).all() for part in weights)


def _claimed(action: Mapping[str, NDArray[Any]], name: str, kind: str) -> NDArray[Any]:
    """Rows of a field that the mask of its kind says are there; all of them without a mask."""
    array, mask = action.get(name, _NOTHING), action.get(f"{kind}_valid")
    return array if mask is None or not len(array) else array[mask != 0]
