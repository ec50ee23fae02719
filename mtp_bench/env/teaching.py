"""What a strict env says of an action: an error for what is no action, a warning for what is surely meant otherwise.

It only looks at answers that were examined already (`checks`), so it costs next to nothing and changes no reward.
"""

from __future__ import annotations

import numpy as np
from gymnasium import logger

from ..errors import ActionError
from ..types import Floats, Task
from .action import COORDINATE_LIMIT, Rows
from .checks import Examined, present
from .problems import Problem

RANDOM_BEYOND = 1e4  # m, of a centre: no agent reports an object there, a random action has hardly any nearer
_TURN = 4 * np.pi  # rad; an agent that never wraps its angles may be some way beyond one turn
_NEAR = 5.0  # m from the origin: whose position and whose offset cannot be told apart
_FASTEST = 75.0  # m/s; nothing that is forecast moves as fast
_BOXES: tuple[tuple[str, Rows], ...] = (("track_box", "tracks"), ("object_box", "objects"))
_SOME = 3  # objects that do not lie by chance where they would if the offsets were positions


class Teacher:
    """Looks at the actions of one env under ``task``."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._told: set[tuple[str, str]] = set()

    def look(self, examined: Examined, where: str) -> None:
        """Raise ActionError for what lies outside the action space; warn, once per env, of what else is wrong.

        ``where`` is the frame in words. Nothing is said of an answer with a box more than 10 km from the origin: it was
        drawn at random from the action space.
        """
        if outside := examined.outside:
            more = f" (and {len(outside) - 1} more)" if len(outside) > 1 else ""
            raise ActionError(_gravest(outside).sentence(where) + more)
        if not _random(examined):
            for problem in [*examined.problems, *_degrees(examined), *_absolute(examined, self._task)]:
                self._warn(problem, where)

    def _warn(self, problem: Problem, where: str) -> None:
        kind = problem.field, problem.reason
        if kind not in self._told:
            self._told.add(kind)
            logger.warn(f"{problem.sentence(where)} (said once per env)")


def _gravest(problems: list[Problem]) -> Problem:
    """The first of what is said of objects, else of tracks; a key that nobody reads often explains a missing one."""
    return min(problems, key=lambda problem: (problem.level == "error", problem.kind != "objects"))


def _random(examined: Examined) -> bool:
    """Whether the boxes were drawn from the action space; rows that are not claimed were drawn with the others."""
    far = [np.abs(examined.arrays[name][:, :2]) for name, _ in _BOXES]
    return any(((part > RANDOM_BEYOND) & (part <= COORDINATE_LIMIT)).any() for part in far)


def _degrees(examined: Examined) -> list[Problem]:
    """Boxes that are turned further than anybody turns."""
    problems: list[Problem] = []
    for name, rows in _BOXES:
        yaw = examined.arrays[name][:, 3]
        turned = np.flatnonzero(examined.sound[rows] & (np.abs(yaw) > _TURN))
        if len(turned):
            example = f"{name}[{turned[0]}, 3] = {yaw[turned[0]]:.4g}"
            advice = "np.radians(yaw) makes radians of degrees"
            reason = "yaw looks like degrees"
            problems.append(_doubt(name, reason, "radians, such as -pi to pi", len(turned), example, advice))
    return problems


def _absolute(examined: Examined, task: Task) -> list[Problem]:
    """Forecasts whose offsets in the first frame are about where the objects themselves are."""
    rows = np.flatnonzero(examined.sound["objects"])
    position = examined.arrays["object_box"][rows, :2].astype(np.float64)
    distance = np.linalg.norm(position, axis=1)
    far = distance > _NEAR
    if not far.any():
        return []
    rows, position, distance = rows[far], position[far], distance[far]
    sample = present(examined.arrays["forecast_log_weight"][rows]).argmax(axis=1)  # the first one that is there
    first = examined.arrays["forecast"][rows, sample, 0]
    as_positions = (np.linalg.norm(first - position, axis=1) <= distance / 4).all()
    if not as_positions or (len(rows) < _SOME and distance.max() * 3 / 4 < _FASTEST * task.dt):
        return []
    expected = "metres from the object's own centre"
    example = f"forecast[{rows[0]}]: {_point(first[0])} in the first frame, the object is at {_point(position[0])}"
    advice = "subtract the centre of the box"
    return [_doubt("forecast", "looks like absolute coordinates", expected, len(rows), example, advice)]


def _point(xy: Floats) -> str:
    return f"({xy[0]:.1f}, {xy[1]:.1f})"


def _doubt(field: str, reason: str, expected: str, rows: int, example: str, advice: str) -> Problem:
    return Problem(field, reason, expected, rows, example, "", "warning", advice, outside=False)
