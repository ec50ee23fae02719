"""`FlattenAction`: the whole action as one vector of numbers from -1 to 1."""

from __future__ import annotations

import math
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..env.action import BOX, CONFIDENCE, COORDINATE_LIMIT, FIELDS, FORECAST_REACH, LOG_WEIGHT, MASK, OFFSET, Field
from ..errors import ActionError, MtpBenchError, sentence
from ..types import Action, Floats, Observation, Task
from .wrapped import require_own_space, require_positive, task_of

FAINTEST = -10.0  # log-weight that stands at -1; at 1 it is 0
_SIZES = 0.1, 20.0  # m, of boxes


@final
class FlattenAction(gymnasium.ActionWrapper[Observation, NDArray[np.float32], Action], RecordConstructorArgs):
    """The action is one Box in [-1, 1]: what agents for continuous control give.

    It holds the fields of the action in their order, `columns` says where; all but ``track_id``, for the identity of a
    track is its row. Of an entry x from -1 to 1 becomes

    - a mask: 1 where x is above 0; a track that no hypothesis holds is not there
    - a class, a parent: as many equal parts of [-1, 1] as there are values
    - a box: x y z up to ``reach`` m from the origin, yaw up to pi, l w h from 0.1 to 20 m
    - a forecast: up to ``speed`` m/s along x and along y, times the time to its frame, and at most 231 m
    - a confidence from 0 to 1, a log-weight from -10 to 0

    Numbers beyond [-1, 1] are cut; what is no such vector is an ActionError. So every action is sound. There are many
    entries at the sizes of a card: choose smaller ones with the keywords of the env.
    ``gymnasium.wrappers.FlattenObservation`` makes one vector of the observation.

    Raises MtpBenchError for a ``reach`` or a ``speed`` that is not above 0, a ``reach`` beyond the coordinates of the
    env, for an env of another library, and around a wrapper that has its own actions.
    """

    def __init__(self, env: gymnasium.Env[Observation, Action], reach: float = 100.0, speed: float = 20.0) -> None:
        for name, value in (("reach", reach), ("speed", speed)):
            require_positive(name, value, "FlattenAction")
        if reach > COORDINATE_LIMIT:
            expected = f"at most {COORDINATE_LIMIT:g} m, as far as coordinates of the env go"
            raise MtpBenchError(sentence(f"reach is {reach!r}", expected, "FlattenAction"))
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
        """The action of the env that the vector stands for."""
        x = np.clip(self._vector(action), -1.0, 1.0)
        said: dict[str, NDArray[Any]] = {"track_id": np.arange(self._task.tracks)}
        for field in FIELDS:
            if field.name in self.columns:
                part = x[self.columns[field.name]].reshape(field.shape_in(self._task))
                said[field.name] = self._entries(field, part).astype(field.content.dtype)
        said["track_valid"] &= said["hypothesis_member"].any(axis=0)
        return said

    def _vector(self, action: object) -> Floats:
        wanted = self.action_space.shape
        expected = f"a vector of {wanted and wanted[0]} finite numbers from -1 to 1"
        try:
            vector = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            raise ActionError(sentence(f"the flat action is a {type(action).__name__}", expected)) from None
        if vector.shape != wanted:
            raise ActionError(sentence(f"the flat action has shape {vector.shape}", expected))
        if not np.isfinite(vector).all():
            raise ActionError(
                sentence("the flat action is not finite", expected, f"entry {np.isfinite(vector).argmin()}")
            )
        return vector

    def _entries(self, field: Field, x: Floats) -> NDArray[Any]:
        """The entries of a field for numbers of its shape."""
        task, content, unit = self._task, field.content, (x + 1) / 2  # unit: from 0 to 1
        if content is MASK:
            return x > 0
        if content is BOX:
            smallest, largest = _SIZES
            size = smallest + (largest - smallest) * unit[:, 4:]
            return np.concatenate([self._reach * x[:, :3], np.pi * x[:, 3:4], size], axis=1)
        if content is OFFSET:
            return np.clip(x * self._speed * _times(task)[:, None], -FORECAST_REACH, FORECAST_REACH)
        if content is CONFIDENCE:
            return unit
        if content is LOG_WEIGHT:
            return FAINTEST * (1 - unit)
        known = field.values_in(task)
        return known.start + np.minimum((unit * len(known)).astype(np.int64), len(known) - 1)


def _times(task: Task) -> Floats:
    return task.dt * np.arange(1, task.future + 1)
