"""Observation and action space: padded arrays whose sizes are constants of the env id."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..agent import (
    ABSENT_LOG_WEIGHT,
    ACTION_FIELDS,
    COORDINATE_LIMIT,
    FORECAST_REACH,
    SIZE_LIMIT,
    ActionField,
    check_action,
)
from ..core import ID_LIMIT, UNKNOWN_OBJECT, Task
from .lanes import SUCCESSORS

SCORE_LIMIT = 1e6
VELOCITY_LIMIT = 1e3  # m/s
_TIME_LIMIT = 1e6  # s
# the space draws ids below this number times the rows: few are drawn twice
_IDS_PER_ROW = 10
_NUMBERS_PER_DETECTION = 13  # box 7, velocity 2, score, class, valid, id

Box = spaces.Box
AnySpaces = dict[str, spaces.Space[Any]]


def observation_space(task: Task) -> spaces.Dict:
    """Return the space of one frame: metres, seconds, radians.

    Rows where ``detection_valid`` is 0 hold zeros, and -1 as class and id. With
    ``observe="truth"`` true boxes come as detections with score 1 and ``detection_id``
    (D,) is added; with ``observe="tracks"`` those of a foreign tracker do. With
    ``observe="associated"`` it is the true object that a detection is matched to, -1
    for none, and -2 in frames that are not annotated.

    A card with lanes adds pieces of the road map in reach of the sensor, nearest first:
    ``lane_point`` (L, Q, 2) along the direction of travel, ``lane_valid`` (L, Q), and
    ``lane_next`` (L, 4), the rows that continue a piece, or -1.
    """
    d = task.detections
    low, high = _pose_bounds()
    fields: AnySpaces = {
        "detection_box": _box_space(d, min_size=0.0),
        "detection_velocity": Box(-VELOCITY_LIMIT, VELOCITY_LIMIT, (d, 2), np.float32),
        "detection_score": Box(-SCORE_LIMIT, SCORE_LIMIT, (d,), np.float32),
        "detection_class": Box(-1, len(task.classes) - 1, (d,), np.int32),
        "detection_valid": spaces.MultiBinary(d),
        "ego_pose": Box(low, high, dtype=np.float32),
        "time": Box(0.0, _TIME_LIMIT, (), np.float64),
        "dt": Box(0.0, _TIME_LIMIT, (), np.float64),
    }
    if task.observe != "detections":
        fields["detection_id"] = Box(UNKNOWN_OBJECT, ID_LIMIT, (d,), np.int64)
    if task.lanes:
        shape = (task.lanes, task.lane_points)
        fields["lane_point"] = Box(
            -COORDINATE_LIMIT, COORDINATE_LIMIT, (*shape, 2), np.float32
        )
        fields["lane_valid"] = spaces.MultiBinary(shape)
        fields["lane_next"] = Box(
            -1, task.lanes - 1, (task.lanes, SUCCESSORS), np.int16
        )
    return spaces.Dict(fields)


def action_numbers(task: Task) -> int:
    """Count the entries of an action, without making it."""
    return sum(math.prod(field.shape_in(task)) for field in ACTION_FIELDS)


def observation_numbers(task: Task) -> int:
    """Count at most the entries of an observation: detections, points of lanes."""
    # x, y and valid of each point
    per_lane = 3 * task.lane_points + SUCCESSORS
    return _NUMBERS_PER_DETECTION * task.detections + task.lanes * per_lane


def _space_of(field: ActionField, task: Task) -> spaces.Space[Any]:
    shape = field.shape_in(task)
    match field.content.name:
        case "id":
            # a Box of ids would not pass Gymnasium's checker, which wants vectors
            # within [-1, 1]
            return spaces.MultiDiscrete(np.full(shape, _IDS_PER_ROW * shape[0]))
        case "log_weight" if len(shape) == 1:
            return Box(-1.0, 1.0, shape, np.float32)
        case "log_weight":
            return Box(ABSENT_LOG_WEIGHT, 0.0, shape, np.float32)
        case "mask":
            return spaces.MultiBinary(shape)
        case "box":
            return _box_space(shape[0], min_size=0.01)
        case "offset":
            return Box(-FORECAST_REACH, FORECAST_REACH, shape, np.float32)
        case "confidence":
            return Box(0.0, 1.0, shape, np.float32)
        case "class" | "parent":
            values = field.values_in(task)
            return spaces.MultiDiscrete(
                np.full(shape, len(values)), start=np.full(shape, values.start)
            )


def _pose_bounds() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the bounds [4] of x, y, z and yaw."""
    high = np.array([COORDINATE_LIMIT] * 3 + [np.pi], dtype=np.float32)
    return -high, high


def _box_space(rows: int, min_size: float) -> spaces.Box:
    low, high = _pose_bounds()
    low = np.concatenate([low, np.full(3, min_size, np.float32)])
    high = np.concatenate([high, np.full(3, SIZE_LIMIT, np.float32)])
    return Box(np.tile(low, (rows, 1)), np.tile(high, (rows, 1)), dtype=np.float32)


class ActionSpace(spaces.Dict):
    """Actions that a strict env accepts under ``task``.

    `contains` runs the same checks. A log-weight of -inf or below -1e30 means absent;
    ``track_class`` -1 means not stated. Every drawn row is sound, unless an id occurs
    twice in a hypothesis or all samples of an object are absent. The space holds more
    than its fields draw: any content of absent rows, missing optional fields, any
    finite angle and log-weight, any id, boxes of any size above 0, and forecasts up to
    327 m in length, of which the field is the inscribed square.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        super().__init__(
            {field.name: _space_of(field, task) for field in ACTION_FIELDS}
        )

    def contains(self, x: Any) -> bool:
        """Return True if a strict env accepts ``x`` as an action."""
        return not check_action(x, self._task).outside
