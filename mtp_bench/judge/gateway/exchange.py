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
from .limits import Limits, SceneRun
from .process import AgentProcess, ExcessError, Message
from .wire import Arrays, WireError, arrays_of

Action = dict[str, Any]
_NOTHING = np.zeros(0)
MOST_REASON = 2000  # characters of an agent's own error text


class SceneOverError(Exception):
    """The scene is over for the agent, see `SceneRun.status`."""

    def __init__(self, status: str, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, clean_text(reason, MOST_REASON)


def answer_bytes(space: spaces.Space[Any], limits: Limits) -> int:
    """Largest size of an answer of this space, bytes."""
    assert isinstance(space, spaces.Dict)
    return min(
        limits.answer,
        sum(8 * math.prod(part.shape or ()) for part in space.spaces.values()),
    )


class Exchange:
    """Questions to one agent and its answers; a failed agent is not asked again."""

    def __init__(
        self,
        process: AgentProcess,
        limits: Limits,
        space: spaces.Space[Any],
        seal: bytes,
    ) -> None:
        self._process, self._limits = process, limits
        assert isinstance(space, spaces.Dict)
        self._shapes = {
            name: tuple(part.shape or ()) for name, part in space.spaces.items()
        }
        self._frame, self._malformed, self._seal = 0, 0, seal
        self._status, self._reason = "finished", ""
        self._begin, self._started = process.begun, 0.0

    def open(self, setup: dict[str, Any], task: dict[str, Any]) -> None:
        """Build the agent and reset it."""
        try:
            self._process.channel.send(setup)
            self._process.channel.send({"kind": "build", "task": task})
            self._expect("built", self._limits.start)
            self._started = time.monotonic() - self._begin
            self._process.channel.send({"kind": "reset", "task": task})
            self._expect("ready", self._limits.reset)
            self._look()
        except SceneOverError as end:
            self._status, self._reason = end.status, end.reason

    def ask(self, observation: Arrays) -> tuple[Action | None, float]:
        """The answer to one frame and the seconds it took; None once the scene is over for the agent.

        A malformed answer is returned without fields, which the env counts as broken.
        """
        action: Action | None = None
        malformed, begin, spent = self._malformed, time.monotonic(), 0.0
        if self._status == "finished":
            try:
                action = self._answer(observation, begin)
                spent = time.monotonic() - begin
                self._look()
            except SceneOverError as end:
                self._status, self._reason, action = end.status, end.reason, None
        self._seal = lengthened(self._seal, self._frame, action)
        self._frame += 1
        broken = action is None and self._malformed > malformed
        return {} if broken else action, spent

    def result(self, rollout: Rollout) -> SceneRun:
        """The finished scene as a `SceneRun`."""
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
        token = secrets.token_hex(
            8
        )  # the answer repeats it, so that no frame is answered before it was shown
        wanted = {"fields": list(self._shapes), "most": self._process.most_bytes}
        self._process.channel.send(
            {"kind": "frame", "frame": self._frame, "token": token, **wanted},
            observation,
        )
        limit = self._limits.first_frame if self._frame == 0 else self._limits.frame
        message = self._message(begin + limit)
        if message is None:
            raise SceneOverError(
                "hung",
                f"no answer to frame {self._frame} in time, expected one within {limit:g} s",
            )
        header = message[0]
        if (header.get("kind"), header.get("frame"), header.get("token")) != (
            "answer",
            self._frame,
            token,
        ):
            reason = "it sent an unexpected message: every frame is answered once, after it was shown"
            raise SceneOverError("rejected", reason)
        return self._checked(message)

    def _checked(self, message: Message) -> Action | None:
        header, body = message
        try:
            if "malformed" not in header:
                arrays = arrays_of(header, body, self._shapes)
                fitting = {
                    name: array for name, array in arrays.items() if array is not None
                }
                if len(fitting) == len(arrays) and _finite(fitting):
                    return fitting
        except (
            Exception
        ) as error:  # any error on reading an answer is the agent's fault
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
        """The next message; an error of the agent and the end of its process end the scene.

        None if it has not come by the ``deadline``, or by that of the scene.
        """
        try:
            message = self._process.receive(
                min(deadline, self._begin + self._limits.scene)
            )
        except EndedError:
            output = self._process.channel.printed()
            reason = f"the process {self._process.exit_text()}" + (
                f"; its last output is {output!r}" if output else ""
            )
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

    def _look(self) -> None:
        if self._process.others():
            raise SceneOverError(
                "rejected", f"it had started other processes at frame {self._frame}"
            )


def lengthened(seal: bytes, frame: int, action: Action | None) -> bytes:
    """The hash chain with one more link: the previous hash, the frame, and the answer or a mark for a missed one."""
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
    return (
        str(error)
        if isinstance(error, WireError)
        else f"{type(error).__name__}: {error}"
    )


def _finite(action: Mapping[str, NDArray[Any]]) -> bool:
    """True if all numbers of valid tracks, hypotheses, objects and samples are finite; else the frame is unanswered.

    ``action``: arrays of the right shapes; fields may be missing. Invalid rows may hold any number, as may samples
    whose log-weight marks them as absent; -inf is such a log-weight, NaN and +inf are not.
    """
    weight, forecast = (
        _valid_rows(action, "forecast_log_weight", "object"),
        _valid_rows(action, "forecast", "object"),
    )
    if (
        forecast.ndim > 1 and weight.shape == forecast.shape[:2]
    ):  # without that field every sample counts
        forecast = forecast[weight >= ABSENT_BELOW]
    numbers = (
        _valid_rows(action, "track_box", "track"),
        _valid_rows(action, "object_box", "object"),
        forecast,
    )
    weights = (weight, action.get("hypothesis_log_weight", _NOTHING))
    return all(np.isfinite(part).all() for part in numbers) and all(
        (part < np.inf).all() for part in weights
    )


def _valid_rows(
    action: Mapping[str, NDArray[Any]], name: str, kind: str
) -> NDArray[Any]:
    """Rows of a field that the mask of its kind marks as valid; all of them without a mask."""
    array, mask = action.get(name, _NOTHING), action.get(f"{kind}_valid")
    return array if mask is None or not len(array) else array[mask != 0]
