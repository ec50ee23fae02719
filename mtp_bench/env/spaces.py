"""Observation and action space: padded arrays whose sizes are constants of the env id."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import utils as flattening
from gymnasium.vector import utils as batching
from numpy.typing import DTypeLike, NDArray

from ..types import ID_LIMIT, Task
from .action import (
    ABSENT,
    BOX,
    CONFIDENCE,
    COORDINATE_LIMIT,
    FIELDS,
    FORECAST_REACH,
    ID,
    LOG_WEIGHT,
    MASK,
    OFFSET,
    SIZE_LIMIT,
    Field,
)
from .checks import examine

SCORE_LIMIT = 1e6
VELOCITY_LIMIT = 1e3  # m/s
TIME_LIMIT = 1e6  # s

Box = spaces.Box
AnySpaces = dict[str, spaces.Space[Any]]


def observation_space(task: Task) -> spaces.Dict:
    """Space of one frame, in the local frame of the scene: metres, seconds, radians.

    Rows where ``detection_valid`` is 0 hold zeros, and -1 as class and id. With ``observe="truth"`` true boxes come as
    detections with score 1 and ``detection_id`` (D,) is added; with ``observe="tracks"`` those of a foreign tracker do.
    """
    d = task.detections
    fields: AnySpaces = {
        "detection_box": _boxes(d, smallest=0.0),
        "detection_velocity": Box(-VELOCITY_LIMIT, VELOCITY_LIMIT, (d, 2), np.float32),
        "detection_score": Box(-SCORE_LIMIT, SCORE_LIMIT, (d,), np.float32),
        "detection_class": Box(-1, len(task.classes) - 1, (d,), np.int32),
        "detection_valid": spaces.MultiBinary(d),
        "ego_pose": Box(*_pose_bounds(), dtype=np.float32),
        "time": Box(0.0, TIME_LIMIT, (), np.float64),
        "dt": Box(0.0, TIME_LIMIT, (), np.float64),
    }
    if task.observe != "detections":
        fields["detection_id"] = Box(-1, ID_LIMIT, (d,), np.int64)
    return spaces.Dict(fields)


def action_numbers(task: Task) -> int:
    """Number of entries of an action, computed before an array of that size is made."""
    return sum(math.prod(field.shape_in(task)) for field in FIELDS)


def observation_numbers(task: Task) -> int:
    """Largest number of entries of an observation: box, velocity, score, class, mask and id of each detection."""
    return 13 * task.detections


def _space_of(field: Field, task: Task) -> spaces.Space[Any]:
    shape, content = field.shape_in(task), field.content
    if content is ID:
        return Numbers(0, ID_LIMIT, shape, content.dtype)
    if content is LOG_WEIGHT:
        return Numbers(ABSENT, 0.0, shape, content.dtype)
    if content is MASK:
        return spaces.MultiBinary(shape)
    if content is BOX:
        return _boxes(shape[0], smallest=0.01)
    if content is OFFSET:
        return Box(-FORECAST_REACH, FORECAST_REACH, shape, np.float32)
    if content is CONFIDENCE:
        return Box(0.0, 1.0, shape, np.float32)
    values = field.values_in(task)
    return spaces.MultiDiscrete(np.full(shape, len(values)), start=np.full(shape, values.start))


def _pose_bounds() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    high = np.array([COORDINATE_LIMIT] * 3 + [np.pi], dtype=np.float32)
    return -high, high


def _boxes(rows: int, smallest: float) -> spaces.Box:
    low, high = _pose_bounds()
    low = np.concatenate([low, np.full(3, smallest, np.float32)])
    high = np.concatenate([high, np.full(3, SIZE_LIMIT, np.float32)])
    return Box(np.tile(low, (rows, 1)), np.tile(high, (rows, 1)), dtype=np.float32)


class ActionSpace(spaces.Dict):
    """Actions that a strict env accepts under ``task``: `contains` runs the same checks.

    A log-weight of -inf or below -1e30 means absent; ``track_class`` -1 means not stated. Every drawn row is sound,
    unless an id occurs twice in a hypothesis or all samples of an object are absent. The space holds more than its
    fields draw: any content of absent rows, missing optional fields, any finite angle and log-weight, boxes of any size
    above 0, and forecasts up to 327 m in length, of which the field is the inscribed square.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        super().__init__({field.name: _space_of(field, task) for field in FIELDS})

    def contains(self, x: Any) -> bool:
        """True if a strict env accepts ``x`` as an action."""
        return not examine(x, self._task).outside


class Numbers(spaces.Space[NDArray[Any]]):
    """Arrays of ``shape`` with entries from ``low`` to ``high``: a Box that is not a continuous control.

    Gymnasium's checker asks every one-dimensional Box of an action space to lie in [-1, 1]. Ids and log-weights cannot,
    so they have a space of their own, which Gymnasium treats as a Box everywhere else.
    """

    def __init__(
        self, low: float, high: float, shape: tuple[int, ...], dtype: DTypeLike, seed: int | None = None
    ) -> None:
        self._box = spaces.Box(low, high, shape, np.dtype(dtype).type)
        self.low, self.high = self._box.low, self._box.high
        super().__init__(shape, self._box.dtype, seed)

    @property
    def is_np_flattenable(self) -> bool:
        """True, as for a Box."""
        return True

    def seed(self, seed: int | None = None) -> int | list[int] | dict[str, int]:
        """Seed the random draws."""
        return self._box.seed(seed)

    def sample(self, mask: Any | None = None, probability: Any | None = None) -> NDArray[Any]:
        """A random element, drawn as from a Box."""
        return self._box.sample(mask, probability)

    def contains(self, x: Any) -> bool:
        """True if ``x`` has the shape, the type and the range."""
        return self._box.contains(x)

    def to_jsonable(self, sample_n: Iterable[NDArray[Any]]) -> list[Any]:
        """Elements as lists of numbers."""
        return self._box.to_jsonable(list(sample_n))

    def from_jsonable(self, sample_n: Sequence[Any]) -> list[NDArray[Any]]:
        """Elements from lists of `to_jsonable`."""
        return self._box.from_jsonable(sample_n)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Numbers) and self._box == other._box

    def __hash__(self) -> int:
        return hash((self.shape, str(self.dtype)))

    def __repr__(self) -> str:
        return self._box.__repr__().replace("Box", "Numbers")


_SINGLE_DISPATCH: tuple[Any, ...] = (
    batching.batch_space,
    batching.concatenate,
    batching.create_empty_array,
    batching.iterate,
    flattening._flat_dtype,
    flattening.flatdim,
    flattening.flatten,
    flattening.flatten_space,
    flattening.unflatten,
)
for _function in _SINGLE_DISPATCH:
    _function.register(Numbers, _function.dispatch(spaces.Box))
