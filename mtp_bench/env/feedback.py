"""Feedback of a strict env on actions that are wrong, or likely mistaken.

An action outside the action space is an error, a likely mistake a warning. The actions
were checked already (`agent.checks`), so it costs little, and it changes no reward.
"""

import numpy as np
from gymnasium import logger

from ..agent import (
    COORDINATE_LIMIT,
    ActionProblem,
    CheckedAction,
    RowKind,
    is_present,
)
from ..core import ActionError, Floats, Task

# m, of a centre: agents report no object there, random actions have hardly any within
RANDOM_BEYOND = 1e4
# an agent that never wraps its angles may be some way beyond one turn
_MAX_YAW_RAD = 4 * np.pi
# closer to the origin positions and offsets cannot be told apart
_MIN_DISTANCE_M = 5.0
_MAX_SPEED_MPS = 75.0  # no forecast object moves as fast
# fewer objects may lie by chance where they would if the offsets were positions
_MIN_OBJECTS = 3
_BOXES: tuple[tuple[str, RowKind], ...] = (
    ("track_box", "tracks"),
    ("object_box", "objects"),
)


class Feedback:
    """Errors and warnings for the actions of one env under ``task``."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._warned: set[tuple[str, str]] = set()

    def give(self, checked: CheckedAction, where: str) -> None:
        """Raise ActionError outside the action space, and warn of other problems.

        Each warning comes once per env. ``where`` names the frame. Actions that were
        drawn from the action space give no warning, see `_is_random`.
        """
        outside = checked.outside
        if outside:
            # unknown keys, which are warnings, come first, since they often explain a
            # missing field; then objects, then tracks
            gravest = min(
                outside,
                key=lambda problem: (
                    problem.level == "error",
                    problem.kind != "objects",
                ),
            )
            text = gravest.sentence(where)
            if len(outside) > 1:
                text += f" (and {len(outside) - 1} more)"
            raise ActionError(text)
        if _is_random(checked):
            return
        problems = [*checked.problems, *_degrees(checked)]
        problems += _absolute_positions(checked, self._task)
        for problem in problems:
            kind = problem.field, problem.reason
            if kind not in self._warned:
                self._warned.add(kind)
                logger.warn(f"{problem.sentence(where)} (said once per env)")


def _is_random(checked: CheckedAction) -> bool:
    """Return True for an action that seems drawn from the action space.

    Such an action has boxes more than 10 km away, also in rows that it does not claim.
    """
    centres = [np.abs(checked.arrays[name][:, :2]) for name, _ in _BOXES]
    return any(
        ((centre > RANDOM_BEYOND) & (centre <= COORDINATE_LIMIT)).any()
        for centre in centres
    )


def _degrees(checked: CheckedAction) -> list[ActionProblem]:
    """Find boxes with a yaw beyond two turns."""
    problems: list[ActionProblem] = []
    for name, kind in _BOXES:
        yaw = checked.arrays[name][:, 3]
        rows = np.flatnonzero(checked.sound[kind] & (np.abs(yaw) > _MAX_YAW_RAD))
        if len(rows):
            problem = ActionProblem(
                name,
                "yaw looks like degrees",
                "radians, such as -pi to pi",
                len(rows),
                example=f"{name}[{rows[0]}, 3] = {yaw[rows[0]]:.4g}",
                level="warning",
                advice="np.radians(yaw) converts degrees",
                outside=False,
            )
            problems.append(problem)
    return problems


def _absolute_positions(checked: CheckedAction, task: Task) -> list[ActionProblem]:
    """Find forecasts whose first offsets are about equal to the objects' positions."""
    arrays = checked.arrays
    distance = np.hypot(*arrays["object_box"][:, :2].T.astype(np.float64))
    rows = np.flatnonzero(checked.sound["objects"] & (distance > _MIN_DISTANCE_M))
    if not len(rows):
        return []
    distance = distance[rows]
    position = arrays["object_box"][rows, :2].astype(np.float64)
    # the first sample that is present, in its first frame
    sample = is_present(arrays["forecast_log_weight"][rows]).argmax(axis=1)
    offset = arrays["forecast"][rows, sample, 0]
    # within a quarter of the distance, since the object moves until then
    as_positions = np.hypot(*(offset - position).T) <= distance / 4
    # A fast object could really move that far, so it takes several objects, or one that
    # would be too fast: its offset is at least 3/4 of its distance.
    too_fast = distance.max() * 3 / 4 >= _MAX_SPEED_MPS * task.dt
    if not as_positions.all() or not (len(rows) >= _MIN_OBJECTS or too_fast):
        return []
    return [
        ActionProblem(
            "forecast",
            "looks like absolute coordinates",
            "metres from the object's own centre",
            len(rows),
            example=f"forecast[{rows[0]}]: {_point_text(offset[0])} in the first frame, "
            f"the object is at {_point_text(position[0])}",
            level="warning",
            advice="subtract the centre of the box",
            outside=False,
        )
    ]


def _point_text(xy: Floats) -> str:
    return f"({xy[0]:.1f}, {xy[1]:.1f})"
