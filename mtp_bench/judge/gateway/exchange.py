"""Questions and answers of one scene: malformed answers, broken rules, and the hash chain over all answers."""

import hashlib
import math
import secrets
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ...core import ABSENT_BELOW, Rollout, clean_text
from .channel import EndedError
from .limits import PROCESS_ENDED, Limits, SceneRun
from .process import AgentProcess, ExcessError, Message
from .wire import Arrays, WireError, arrays_of

Action = dict[str, Any]
_NOTHING = np.zeros(0)
_MAX_REASON = 2000  # characters of an agent's own error text
_NUMBER_BYTES = 8  # of the largest dtype


class SceneOverError(Exception):
    """The scene is over for the agent, see `SceneRun.status`."""

    def __init__(self, status: str, reason: str) -> None:
        super().__init__(reason)
        self.status = status
        self.reason = clean_text(reason, _MAX_REASON)


def answer_bytes(space: spaces.Space[Any], limits: Limits) -> int:
    """Return the largest size of an answer of this space, bytes."""
    assert isinstance(space, spaces.Dict)
    numbers = sum(math.prod(part.shape or ()) for part in space.spaces.values())
    return min(limits.answer, _NUMBER_BYTES * numbers)


class Exchange:
    """Questions to one agent and its answers.

    A failed agent is not asked again.
    """

    def __init__(
        self,
        process: AgentProcess,
        limits: Limits,
        space: spaces.Space[Any],
        seal: bytes,
    ) -> None:
        """Begin with frame 0.

        ``space``: of actions. ``seal``: start of the hash chain over the answers.
        """
        self._process = process
        self._limits = limits
        assert isinstance(space, spaces.Dict)
        self._shapes = {
            name: tuple(part.shape or ()) for name, part in space.spaces.items()
        }
        self._frame = 0
        self._malformed = 0
        self._seal = seal
        self._status = "finished"
        self._reason = ""
        self._begin = process.begun
        self._started = 0.0  # s that building the agent took

    def open(self, setup: dict[str, Any], task: dict[str, Any]) -> None:
        """Build the agent and reset it."""
        try:
            self._process.channel.send(setup)
            self._process.channel.send({"kind": "build", "task": task})
            self._expect("built", self._limits.start)
            self._started = time.monotonic() - self._begin
            self._process.channel.send({"kind": "reset", "task": task})
            self._expect("ready", self._limits.reset)
            self._require_no_processes()
        except SceneOverError as end:
            self._end(end)

    def _end(self, end: SceneOverError) -> None:
        self._status = end.status
        self._reason = end.reason

    def ask(self, observation: Arrays) -> tuple[Action | None, float]:
        """Return the answer to one frame and the seconds it took.

        None once the scene is over for the agent. A malformed answer is returned
        without fields, which the env counts as broken.
        """
        action: Action | None = None
        malformed_before = self._malformed
        begin = time.monotonic()
        seconds = 0.0
        if self._status == "finished":
            try:
                action = self._answer(observation, begin)
                seconds = time.monotonic() - begin
                self._require_no_processes()
            except SceneOverError as end:
                self._end(end)
                action = None
        self._seal = lengthened(self._seal, self._frame, action)
        self._frame += 1
        if action is None and self._malformed > malformed_before:
            action = {}
        return action, seconds

    def result(self, rollout: Rollout) -> SceneRun:
        """Return the finished scene as a `SceneRun`."""
        return SceneRun(
            rollout=rollout,
            seal=self._seal.hex(),
            status=self._status,
            reason=self._reason,
            malformed=self._malformed,
            peak_memory=self._process.peak_memory(),
            started=self._started,
            isolation=self._process.isolation,
        )

    def _answer(self, observation: Arrays, begin: float) -> Action | None:
        # the answer repeats the token, so that no frame is answered before it was shown
        token = secrets.token_hex(8)
        order = {
            "kind": "frame",
            "frame": self._frame,
            "token": token,
            "fields": list(self._shapes),
            "most": self._process.most_bytes,
        }
        self._process.channel.send(order, observation)
        limit = self._limits.first_frame if self._frame == 0 else self._limits.frame
        message = self._message(begin + limit)
        if message is None:
            raise SceneOverError(
                "hung",
                f"no answer to frame {self._frame} in time, "
                f"expected one within {limit:g} s",
            )
        header, _ = message
        got = [header.get(key) for key in ("kind", "frame", "token")]
        if got != ["answer", self._frame, token]:
            raise SceneOverError(
                "rejected",
                "it sent an unexpected message: every frame is answered once, "
                "after it was shown",
            )
        return self._read_answer(message)

    def _read_answer(self, message: Message) -> Action | None:
        """Return the arrays of an answer.

        None for a malformed one, which is counted.
        """
        header, body = message
        try:
            if "malformed" not in header:
                arrays = arrays_of(header, body, self._shapes)
                fitting = {
                    name: array for name, array in arrays.items() if array is not None
                }
                if len(fitting) == len(arrays) and _finite(fitting):
                    return fitting
        except Exception as error:  # any error here is the agent's fault
            raise SceneOverError(
                "rejected", f"it broke the wire format: {_error_text(error)}"
            ) from None
        self._malformed += 1
        return None

    def _expect(self, kind: str, seconds: float) -> None:
        message = self._message(time.monotonic() + seconds)
        if message is None:
            raise SceneOverError("hung", f"not {kind} within {seconds:g} s")
        if message[0].get("kind") != kind:
            raise SceneOverError(
                "rejected",
                f"it sent {str(message[0].get('kind'))[:20]!r}, expected {kind!r}",
            )

    def _message(self, deadline: float) -> Message | None:
        """Return the next message.

        An error of the agent and the end of its process end the scene. None if it has
        not come by the ``deadline``, or by that of the scene.
        """
        try:
            scene_deadline = self._begin + self._limits.scene
            message = self._process.receive(min(deadline, scene_deadline))
        except EndedError:
            output = self._process.channel.printed()
            reason = f"{PROCESS_ENDED}{self._process.exit_text()}"
            if output:
                reason += f"; its last output is {output!r}"
            raise SceneOverError("crashed", reason) from None
        except ExcessError as error:
            raise SceneOverError("rejected", str(error)) from None
        except Exception as error:
            raise SceneOverError(
                "rejected", f"it broke the wire format: {_error_text(error)}"
            ) from None
        if message is not None and message[0].get("kind") == "error":
            raise SceneOverError("crashed", str(message[0].get("text")))
        return message

    def _require_no_processes(self) -> None:
        if self._process.count_started():
            raise SceneOverError(
                "rejected", f"it had started other processes at frame {self._frame}"
            )


def lengthened(seal: bytes, frame: int, action: Action | None) -> bytes:
    """Lengthen the hash chain by one link.

    The link is the hash of the previous one, the frame, and the answer or a mark for a
    missed one.
    """
    parts: list[bytes | memoryview] = [seal, frame.to_bytes(8, "little")]
    if action is None:
        parts.append(b"missed")  # as in the seals of stored records
    for name, array in sorted((action or {}).items()):
        parts += [
            f"|{name} {array.dtype.str} {list(array.shape)}|".encode(),
            array.data,
        ]
    return hashlib.sha256(b"".join(parts)).digest()


def _error_text(error: Exception) -> str:
    if isinstance(error, WireError):
        return str(error)
    return f"{type(error).__name__}: {error}"


def _finite(action: Mapping[str, NDArray[Any]]) -> bool:
    """Return True if all numbers of valid rows are finite.

    Otherwise the answer is malformed.
    ``action``: arrays of the right shapes; fields may be missing. Invalid rows may hold
    any number, as may samples whose log-weight marks them as absent; -inf is such a
    log-weight, NaN and +inf are not.
    """
    weight = _valid_rows(action, "forecast_log_weight", "object")
    forecast = _valid_rows(action, "forecast", "object")
    # without the field of weights every sample counts
    if forecast.ndim > 1 and weight.shape == forecast.shape[:2]:
        forecast = forecast[weight >= ABSENT_BELOW]
    numbers = (
        _valid_rows(action, "track_box", "track"),
        _valid_rows(action, "object_box", "object"),
        forecast,
    )
    weights = (weight, action.get("hypothesis_log_weight", _NOTHING))
    all_finite = all(np.isfinite(part).all() for part in numbers)
    return all_finite and all((part < np.inf).all() for part in weights)


def _valid_rows(
    action: Mapping[str, NDArray[Any]], name: str, kind: str
) -> NDArray[Any]:
    """Return the valid rows of a field.

    All of them without a mask.
    """
    array: NDArray[Any] = action.get(name, _NOTHING)
    mask = action.get(f"{kind}_valid")
    if mask is not None and len(array):
        array = array[mask != 0]
    return array
