"""Dishonest agents of a closed loop: what stp states, changed before the planner reads it.

`benchmarks/driving.py measure --attacks` lets them drive; none may drive significantly better than stp.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mtp_bench import Action, Agent, Observation, Task, load_submission, make_action

GRID = 16  # objects along each side of the square around the ego
STEP = 4.0  # m between them, too little to drive through
AWAY = 200.0  # m


class Everywhere:
    """Standing objects on a grid around the ego, all with confidence 1."""

    def __init__(self, task: Task) -> None:
        self._task = task

    def reset(self, task: Task) -> None:
        """A new scene."""
        self._task = task

    def act(self, observation: Observation) -> Action:
        """The grid at the place of the ego."""
        side = STEP * (np.arange(GRID) - (GRID - 1) / 2)
        place = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        box = np.tile([0.0, 0.0, 0.0, 0.0, 4.5, 1.9, 1.6], (len(place), 1))
        box[:, :2] = observation["ego_pose"][:2] + place
        classes = np.zeros(len(box), dtype=int)
        return make_action(
            self._task,
            box,
            classes,
            np.zeros((len(box), self._task.future, 2)),
            checked=False,
        )


class Changed:
    """stp, whose actions ``change`` replaces; it is given the action of the frame before, too, and the frame."""

    def __init__(
        self, task: Task, change: Callable[[Action, Action, int], Action]
    ) -> None:
        self._agent: Agent = load_submission("stp").build(task)
        self._change = change

    def reset(self, task: Task) -> None:
        """A new scene."""
        self._agent.reset(task)
        nothing = np.zeros((0, task.future, 2))
        self._none = self._before = make_action(
            task, np.zeros((0, 7)), np.zeros(0, dtype=int), nothing
        )
        self._frame = 0

    def act(self, observation: Observation) -> Action:
        """The changed action."""
        action = self._agent.act(observation)
        changed = self._change(action, self._before, self._frame)
        self._before, self._frame = action, self._frame + 1
        return changed


def everywhere(task: Task) -> Agent:
    """Objects everywhere, confidence 1."""
    return Everywhere(task)


def far_away(task: Task) -> Agent:
    """All objects of stp, `AWAY` m from their places."""
    return Changed(task, lambda now, before, frame: {**now, "object_box": _moved(now)})


def flickering(task: Task) -> Agent:
    """The objects of stp in every other frame."""
    return Changed(
        task,
        lambda now, before, frame: now if frame % 2 == 0 else _without_objects(now),
    )


def late(task: Task) -> Agent:
    """The objects of stp one frame later."""
    return Changed(task, lambda now, before, frame: before)


def sure(task: Task) -> Agent:
    """The objects of stp, all with confidence 1."""
    return Changed(
        task,
        lambda now, before, frame: {
            **now,
            "object_confidence": np.ones(task.objects, np.float32),
        },
    )


def _moved(action: Action) -> np.ndarray:
    box = action["object_box"].copy()
    box[:, 0] += AWAY
    return box


def _without_objects(action: Action) -> Action:
    return {**action, "object_valid": np.zeros_like(action["object_valid"])}


ATTACKS: dict[str, Callable[[Task], Agent]] = {
    each.__name__: each for each in (everywhere, far_away, flickering, late, sure)
}
