"""Feedback of a strict env: an error for an action outside the action space, a warning for a likely mistake.

It looks at actions that were examined already (`checks`), so it costs little, and it changes no reward.
"""

import numpy as np
from gymnasium import logger

from ..agent import COORDINATE_LIMIT, ActionProblem, Examined, Rows, present
from ..core import ActionError, Floats, Task

RANDOM_BEYOND = 1e4  # m, of a centre: agents report no object there, a random action has hardly any nearer
_TURN = (
    4 * np.pi
)  # rad; an agent that never wraps its angles may be some way beyond one turn
_NEAR = 5.0  # m from the origin: positions and offsets cannot be told apart there
_FASTEST = 75.0  # m/s; no forecast object moves as fast
_BOXES: tuple[tuple[str, Rows], ...] = (
    ("track_box", "tracks"),
    ("object_box", "objects"),
)
_FEW = (
    3  # fewer objects may lie by chance where they would if the offsets were positions
)


class Feedback:
    """Errors and warnings for the actions of one env under ``task``."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._warned: set[tuple[str, str]] = set()

    def give(self, examined: Examined, where: str) -> None:
        """Raise ActionError for an action outside the action space; warn, once per env, of other problems.

        ``where`` names the frame. Actions that were drawn from the action space give no warning, see `_is_random`.
        """
        if outside := examined.outside:
            more = f" (and {len(outside) - 1} more)" if len(outside) > 1 else ""
            # unknown keys come first, since they often explain a missing field; then objects, then tracks
            gravest = min(
                outside,
                key=lambda problem: (
                    problem.level == "error",
                    problem.kind != "objects",
                ),
            )
            raise ActionError(gravest.sentence(where) + more)
        if _is_random(examined):
            return
        for problem in [
            *examined.problems,
            *_degrees(examined),
            *_absolute(examined, self._task),
        ]:
            kind = problem.field, problem.reason
            if kind not in self._warned:
                self._warned.add(kind)
                logger.warn(f"{problem.sentence(where)} (said once per env)")


def _is_random(examined: Examined) -> bool:
    """True for a box more than 10 km from the origin: it was drawn. Rows that are not claimed are drawn with others."""
    centres = [np.abs(examined.arrays[name][:, :2]) for name, _ in _BOXES]
    return any(
        ((part > RANDOM_BEYOND) & (part <= COORDINATE_LIMIT)).any() for part in centres
    )


def _degrees(examined: Examined) -> list[ActionProblem]:
    """Boxes with a yaw beyond two turns."""
    problems: list[ActionProblem] = []
    for name, rows in _BOXES:
        yaw = examined.arrays[name][:, 3]
        turned = np.flatnonzero(examined.sound[rows] & (np.abs(yaw) > _TURN))
        if len(turned):
            example = f"{name}[{turned[0]}, 3] = {yaw[turned[0]]:.4g}"
            expected, advice = (
                "radians, such as -pi to pi",
                "np.radians(yaw) converts degrees",
            )
            problems.append(
                _doubt(
                    name,
                    "yaw looks like degrees",
                    expected,
                    len(turned),
                    example,
                    advice,
                )
            )
    return problems


def _absolute(examined: Examined, task: Task) -> list[ActionProblem]:
    """Forecasts whose offsets in the first frame are about equal to the positions of the objects."""
    rows = np.flatnonzero(examined.sound["objects"])
    position = examined.arrays["object_box"][rows, :2].astype(np.float64)
    distance = np.hypot(*position.T)
    far = distance > _NEAR
    if not far.any():
        return []
    rows, position, distance = rows[far], position[far], distance[far]
    sample = present(examined.arrays["forecast_log_weight"][rows]).argmax(
        axis=1
    )  # the first present one
    first = examined.arrays["forecast"][rows, sample, 0]
    as_positions = (np.hypot(*(first - position).T) <= distance / 4).all()
    if not as_positions or (
        len(rows) < _FEW and distance.max() * 3 / 4 < _FASTEST * task.dt
    ):
        return []
    expected = "metres from the object's own centre"
    example = f"forecast[{rows[0]}]: {_point(first[0])} in the first frame, the object is at {_point(position[0])}"
    advice = "subtract the centre of the box"
    return [
        _doubt(
            "forecast",
            "looks like absolute coordinates",
            expected,
            len(rows),
            example,
            advice,
        )
    ]


def _point(xy: Floats) -> str:
    return f"({xy[0]:.1f}, {xy[1]:.1f})"


def _doubt(
    field: str, reason: str, expected: str, rows: int, example: str, advice: str
) -> ActionProblem:
    return ActionProblem(
        field, reason, expected, rows, example, "", "warning", advice, outside=False
    )
