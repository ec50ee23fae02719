"""Agents that state something else than they believe: a baseline whose actions are changed before the planner reads them.

"stp: late" is the baseline `stp` with the change "late". `ATTACKS` are those that a page lists, all of them of stp.
`SCAN` are the mild ones, which an agent could use to drive better without forecasting better: another scale of its
confidence, floors and ceilings, and narrower or wider samples (`benchmarks/driving_honesty.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from mtp_bench import Action, Agent, Observation, Task, make_action
from mtp_bench.core import Floats

GRID = 16  # objects along each side of the square around the ego
STEP_M = 4.0  # between them, too little to drive through
AWAY_M = 200.0
CAR = (0.0, 4.5, 1.9, 1.6)  # yaw, length, width, height
GHOSTS_M = (6.0, 12.0, 18.0)  # behind the ego
WAIT_S = 2.0  # that objects leave late
PEAK_M = 4.0  # from the forecast place to either of two peaks


@dataclass(frozen=True)
class Statement:
    """Action of an agent in a frame, and what else a change may use."""

    task: Task
    action: Action
    before: Action  # the action of the frame before; without objects in the first frame
    frame: int
    ego: Floats  # x y z yaw


Change = Callable[[Statement], Action]


class ChangedAgent:
    """An agent whose actions are changed."""

    def __init__(self, agent: Agent, change: Change) -> None:
        self._agent = agent
        self._change = change

    def reset(self, task: Task) -> None:
        """A new scene."""
        self._agent.reset(task)
        self._task = task
        self._before = _objects(task, np.zeros((0, 7)))
        self._frame = 0

    def act(self, observation: Observation) -> Action:
        """The changed action."""
        action = self._agent.act(observation)
        ego = observation["ego_pose"].astype(float)
        stated = Statement(self._task, action, self._before, self._frame, ego)
        self._before = action
        self._frame += 1
        return self._change(stated)


def _objects(task: Task, box: Floats) -> Action:
    """Standing objects with confidence 1."""
    classes = np.zeros(len(box), dtype=int)
    forecast = np.zeros((len(box), task.future, 2))
    return make_action(task, box, classes, forecast, checked=False)


def everywhere(stated: Statement) -> Action:
    """Standing objects on a grid around the ego."""
    side = STEP_M * (np.arange(GRID) - (GRID - 1) / 2)
    place = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    box = np.tile([0.0, 0.0, 0.0, *CAR], (len(place), 1))
    box[:, :2] = stated.ego[:2] + place
    return _objects(stated.task, box)


def far_away(stated: Statement) -> Action:
    """All objects `AWAY_M` from their places."""
    box = stated.action["object_box"].copy()
    box[:, 0] += AWAY_M
    return {**stated.action, "object_box": box}


def flickering(stated: Statement) -> Action:
    """No object in every other frame."""
    if stated.frame % 2 == 0:
        return stated.action
    return _without(stated.action, np.ones(stated.task.objects, dtype=bool))


def late(stated: Statement) -> Action:
    """The objects of the frame before."""
    return stated.before


def leaves_late(stated: Statement) -> Action:
    """Objects that stand for `WAIT_S` before they drive as forecast."""
    path = stated.action["forecast"]
    wait = round(WAIT_S / stated.task.dt)
    waited = np.zeros_like(path)
    waited[:, :, wait:] = path[:, :, :-wait]
    return {**stated.action, "forecast": waited}


def two_peaks(stated: Statement) -> Action:
    """Samples on either side of their places, none at them."""
    path = stated.action["forecast"].copy()
    yaw = stated.action["object_box"][:, 3]
    aside = PEAK_M * np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    path[:, ::2] += aside[:, None, None]
    path[:, 1::2] -= aside[:, None, None]
    return {**stated.action, "forecast": path}


def nobody_oncoming(stated: Statement) -> Action:
    """No object that faces the ego."""
    turn = stated.action["object_box"][:, 3] - stated.ego[3]
    return _without(stated.action, np.cos(turn) < -0.5)


def small_boxes(stated: Statement) -> Action:
    """Boxes of half the length and width."""
    box = stated.action["object_box"].copy()
    box[:, 4:6] /= 2
    return {**stated.action, "object_box": box}


def wide_boxes(stated: Statement) -> Action:
    """Boxes three times as wide: the planner leaves out motion of less than .65 widths per second."""
    box = stated.action["object_box"].copy()
    box[:, 5] *= 3
    return {**stated.action, "object_box": box}


def ghosts_behind(stated: Statement) -> Action:
    """Certain objects close behind the ego, as if it had to hurry."""
    action = {name: values.copy() for name, values in stated.action.items()}
    free = np.flatnonzero(action["object_valid"] == 0)[: len(GHOSTS_M)]
    yaw = stated.ego[3]
    box = np.tile([0.0, 0.0, stated.ego[2], *CAR], (len(free), 1))
    box[:, :2] = stated.ego[:2] - np.outer(
        GHOSTS_M[: len(free)], [np.cos(yaw), np.sin(yaw)]
    )
    box[:, 3] = yaw
    ghosts = _objects(stated.task, box)
    for name, values in action.items():
        if name.startswith(("object", "forecast")):
            values[free] = ghosts[name][: len(free)]
    return action


def confidence(stated: Statement, new: Callable[[Floats], Floats]) -> Action:
    """Other confidences."""
    changed = np.clip(new(stated.action["object_confidence"]), 0.0, 1.0)
    return {**stated.action, "object_confidence": changed.astype(np.float32)}


def spread(stated: Statement, factor: float) -> Action:
    """Samples ``factor`` times as far from their mean."""
    log_weight = stated.action["forecast_log_weight"].astype(float)
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True, initial=-700.0))
    weight = (
        weight[..., None, None]
        / np.maximum(weight.sum(axis=1), 1e-9)[:, None, None, None]
    )
    path = stated.action["forecast"]
    mean = (weight * np.where(weight > 0, path, 0.0)).sum(axis=1, keepdims=True)
    changed = np.where(weight > 0, mean + factor * (path - mean), path)
    return {**stated.action, "forecast": changed.astype(np.float32)}


def both(stated: Statement, first: Change, second: Change) -> Action:
    """One change after the other."""
    action = first(stated)
    return second(
        Statement(stated.task, action, stated.before, stated.frame, stated.ego)
    )


def _without(action: Action, left_out: np.ndarray) -> Action:
    valid = np.where(left_out, 0, action["object_valid"])
    return {**action, "object_valid": valid.astype(action["object_valid"].dtype)}


def _scaled(scale: float) -> Change:
    return partial(confidence, new=lambda stated: scale * stated)


SCAN: dict[str, Change] = {
    "scale 0.25": _scaled(0.25),
    "scale 0.5": _scaled(0.5),
    "scale 0.75": _scaled(0.75),
    "scale 1.5": _scaled(1.5),
    "scale 2": _scaled(2.0),
    "floor 0.3": partial(confidence, new=lambda stated: np.maximum(stated, 0.3)),
    "none below 0.3": partial(
        confidence, new=lambda stated: np.where(stated < 0.3, 0.0, stated)
    ),
    "ceiling 0.8": partial(confidence, new=lambda stated: np.minimum(stated, 0.8)),
    "ceiling 0.5": partial(confidence, new=lambda stated: np.minimum(stated, 0.5)),
    "samples half as wide": partial(spread, factor=0.5),
    "samples at their mean": partial(spread, factor=0.0),
    "samples 1.5 times as wide": partial(spread, factor=1.5),
    "samples twice as wide": partial(spread, factor=2.0),
    "scale 0.75 and samples at their mean": partial(
        both, first=_scaled(0.75), second=partial(spread, factor=0.0)
    ),
}
CHANGES: dict[str, Change] = SCAN | {
    "everywhere": everywhere,
    "far away": far_away,
    "flickering": flickering,
    "late": late,
    "all certain": partial(confidence, new=np.ones_like),
    "leaves late": leaves_late,
    "two peaks": two_peaks,
    "nobody oncoming": nobody_oncoming,
    "small boxes": small_boxes,
    "wide boxes": wide_boxes,
    "ghosts behind": ghosts_behind,
}
ATTACKS = tuple(
    f"stp: {change}"
    for change in (
        *(name for name in CHANGES if name not in SCAN),
        "scale 0.5",
        "samples at their mean",
    )
)


def base_of(agent: str) -> str:
    """The baseline of a label such as "stp: late"."""
    return agent.partition(": ")[0]


def change_of(agent: str) -> str:
    """The change of a label such as "stp: late"; empty for a baseline as it is."""
    return agent.partition(": ")[2]


def changed(agent: str, made: Agent) -> Agent:
    """The agent ``made`` of the baseline of a label, with the change of the label."""
    change = change_of(agent)
    return ChangedAgent(made, CHANGES[change]) if change else made
