"""`FlattenAction`: the whole action as one vector of numbers from -1 to 1."""

from __future__ import annotations

import math
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..env.action import BOX, CONFIDENCE, COORDINATE_LIMIT, FIELDS, FORECAST_REACH, LOG_WEIGHT, MASK, OFFSET, Field
from ..errors import ActionError, MtpBenchError, describe_problem
from ..types import Action, Floats, Observation, Task

FAINTEST = -10.0  # log-weight at -1; at 1 it is 0
_SIZES = 0.1, 20.0  # m, of boxes


@final
class FlattenAction(gymnasium.ActionWrapper[Observation, NDArray[np.float32], Action], RecordConstructorArgs):
    """The action is one Box in [-1, 1]: what agents for continuous control give.

    It holds all fields of the action but ``track_id`` in their order, at `columns`; the identity of a track is its row.
    An entry x from -1 to 1 becomes

    - a mask: 1 where x is above 0; a track that no hypothesis holds is absent
    - a class, a parent: as many equal parts of [-1, 1] as there are values
    - a box: x y z up to ``reach`` m from the origin, yaw up to pi, l w h from 0.1 to 20 m
    - a forecast: up to ``speed`` m/s along x and along y, times the time to its frame, and at most 231 m
    - a confidence from 0 to 1, a log-weight from -10 to 0

    Numbers beyond [-1, 1] are clipped, so every vector of the right size is a sound action; others are an ActionError.
    There are many entries at the sizes of a card: choose smaller ones with the keywords of the env.
    ``gymnasium.wrappers.FlattenObservation`` makes one vector of the observation.

    Raises MtpBenchError for a ``reach`` or a ``speed`` that is not above 0, a ``reach`` beyond the coordinates of the
    env, for an env of another library, and around a wrapper that has its own actions.
    """

    def __init__(self, env: gymnasium.Env[Observation, Action], reach: float = 100.0, speed: float = 20.0) -> None:
        for name, value in (("reach", reach), ("speed", speed)):
            require_positive(name, value, "FlattenAction")
        if reach > COORDINATE_LIMIT:
            expected = f"at most {COORDINATE_LIMIT:g} m, as far as coordinates of the env go"
            raise MtpBenchError(describe_problem(f"reach is {reach!r}", expected, "FlattenAction"))
        RecordConstructorArgs.__init__(self, reach=reach, speed=speed)
        gymnasium.ActionWrapper.__init__(self, env)
        self._task = task_of(env, "FlattenAction")
        require_own_space(env, "action_space", "FlattenAction")
        self._reach, self._speed = reach, speed
        self.columns: dict[str, slice] = {}
        end = 0
        for field in FIELDS:
            if field.name != "track_id":
                begin, end = end, end + math.prod(field.shape_in(self._task))
                self.columns[field.name] = slice(begin, end)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (end,), np.float32)

    def action(self, action: NDArray[np.float32]) -> Action:
        """The action of the env for a vector."""
        x = np.clip(self._vector(action), -1.0, 1.0)
        fields: dict[str, NDArray[Any]] = {"track_id": np.arange(self._task.tracks)}
        for field in FIELDS:
            if field.name in self.columns:
                part = x[self.columns[field.name]].reshape(field.shape_in(self._task))
                fields[field.name] = self._entries(field, part).astype(field.content.dtype)
        fields["track_valid"] &= fields["hypothesis_member"].any(axis=0)
        return fields

    def _vector(self, action: object) -> Floats:
        shape = self.action_space.shape
        expected = f"a vector of {shape and shape[0]} finite numbers from -1 to 1"
        try:
            vector = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            raise ActionError(describe_problem(f"the flat action is a {type(action).__name__}", expected)) from None
        if vector.shape != shape:
            raise ActionError(describe_problem(f"the flat action has shape {vector.shape}", expected))
        if not np.isfinite(vector).all():
            raise ActionError(
                describe_problem("the flat action is not finite", expected, f"entry {np.isfinite(vector).argmin()}")
            )
        return vector

    def _entries(self, field: Field, x: Floats) -> NDArray[Any]:
        """Entries of a field from numbers from -1 to 1, of the same shape."""
        task, content, unit = self._task, field.content, (x + 1) / 2  # unit: from 0 to 1
        if content is MASK:
            return x > 0
        if content is BOX:
            smallest, largest = _SIZES
            size = smallest + (largest - smallest) * unit[:, 4:]
            return np.concatenate([self._reach * x[:, :3], np.pi * x[:, 3:4], size], axis=1)
        if content is OFFSET:
            times = task.dt * np.arange(1, task.future + 1)
            return np.clip(x * self._speed * times[:, None], -FORECAST_REACH, FORECAST_REACH)
        if content is CONFIDENCE:
            return unit
        if content is LOG_WEIGHT:
            return FAINTEST * (1 - unit)
        values = field.values_in(task)
        return values.start + np.minimum((unit * len(values)).astype(np.int64), len(values) - 1)


def task_of(env: gymnasium.Env[Any, Any], wrapper: str) -> Task:
    """The task of ``env``; raises MtpBenchError, naming the ``wrapper``, for an env of another library."""
    from ..env import MTPEnv

    inner = env.unwrapped
    if not isinstance(inner, MTPEnv):
        expected = 'one of mtp_bench, such as gym.make("MTP-Roundabout-v0")'
        raise MtpBenchError(describe_problem(f"the env is a {type(inner).__name__}", expected, wrapper))
    return inner.task


def require_own_space(env: gymnasium.Env[Any, Any], name: str, wrapper: str) -> None:
    """Raise MtpBenchError, naming the ``wrapper``, if another wrapper has changed the space called ``name``."""
    space = getattr(env, name)
    if not isinstance(space, gymnasium.spaces.Dict):
        got = f"the {name} of the env is a {type(space).__name__}"
        raise MtpBenchError(describe_problem(got, "the Dict that it has before another wrapper changes it", wrapper))


def require_positive(name: str, value: Any, wrapper: str, whole: bool = False) -> None:
    """Raise MtpBenchError, naming the ``wrapper``, unless ``value`` is finite and above 0 (``whole``: an integer)."""
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, kinds) or not 0 < value < np.inf:
        expected = f"a {'whole' if whole else 'finite'} number above 0"
        raise MtpBenchError(describe_problem(f"{name} is {value!r}", expected, wrapper))
