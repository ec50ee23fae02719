"""Tracks from choices: a detection is ignored, begins a track or continues one near it."""

import copy

import numpy as np
from numpy.typing import NDArray

from ..agent import Pipeline, Predictor, Presence
from ..geometry import rotate
from ..types import Action, Ints, Observation, Task
from .slots import FREE, Slots

IGNORE = 0  # the choice that leaves a detection out
NEW = 1  # the choice that begins a track
CONTINUE = 2  # CONTINUE + i: the choice of the i-th nearest track
MOST_TRACKS = 64  # at a time
_PATIENCE = 2  # frames without a detection before a track ends
_REACH = 100.0  # m; unit of observed positions
OWN, _OF_TRACK = 4, 4  # columns of a detection beside its class, and of each track near it


def nearest(table: NDArray[np.float32], task: Task) -> Ints:
    """The obvious choices [M] of a table: the nearest track if there is one, else a new one."""
    return np.where(table[:, OWN + len(task.classes)] > 0, CONTINUE, NEW)


class Associator:
    """Tracks of one scene and their forecasts, by the rules and with the table of `AssociationOnly`."""

    def __init__(
        self, task: Task, predictor: Predictor, presence: Presence | None, rows: int, choices: int, near: float
    ) -> None:
        from ..prediction import KMeansSampler

        self._task, self._choices, self._near = task, choices, near
        self.shape = rows, OWN + len(task.classes) + _OF_TRACK * choices  # of the table
        self._slots = Slots(MOST_TRACKS, _PATIENCE)
        self._agent = Pipeline(self._slots, predictor, KMeansSampler(), presence=presence)

    def reset(self) -> None:
        """Begin a scene."""
        self._agent.reset(self._task)

    def look(self, observation: Observation) -> NDArray[np.float32]:
        """The table of a frame, and the tracks that its detections may continue."""
        self._seen, slots = observation, self._slots
        if self._task.after_hole(observation):
            slots.begin(self._task)
        valid = np.flatnonzero(observation["detection_valid"])
        self._rows = valid[np.argsort(-observation["detection_score"][valid], kind="stable")][: self.shape[0]]
        box, score = observation["detection_box"][self._rows], observation["detection_score"][self._rows]
        class_id, pose = observation["detection_class"][self._rows], observation["ego_pose"]
        distance = np.linalg.norm(box[:, None, :2] - slots.expected[None, :, :2], axis=2)
        distance[(class_id[:, None] != slots.class_id) | (slots.identity == FREE) | (distance >= self._near)] = np.inf
        order = np.argsort(distance, axis=1, kind="stable")[:, : self._choices]
        self._distance = np.take_along_axis(distance, order, axis=1)
        self._order = np.where(np.isfinite(self._distance), order, FREE)  # [m, choices] slots
        exists, slot = self._order != FREE, self._order
        nearness = np.maximum(0, 1 - self._distance / self._near)
        certainty = 1 - 1 / np.maximum(slots.hits[slot], 1)
        waited = slots.unseen[slot] / (_PATIENCE + 1)
        columns = np.where(exists, np.stack([exists, nearness, certainty, waited]), 0).transpose(1, 2, 0)
        table = np.zeros(self.shape)
        table[: len(box)] = np.concatenate(
            [
                np.ones((len(box), 1)),
                (score / (1 + np.abs(score)))[:, None],
                rotate(box[:, :2] - pose[:2], -float(pose[3])) / _REACH,
                class_id[:, None] == np.arange(len(self._task.classes)),
                columns.reshape(len(box), _OF_TRACK * self._choices),
            ],
            axis=1,
        )
        shown = np.clip(table, -1, 1).astype(np.float32)
        self.nearest = nearest(shown, self._task)
        return shown

    def act(self, choice: Ints) -> Action:
        """The action of the frame after these choices [M]."""
        self._slots.choose(*self._resolved(choice[: len(self._rows)]))
        return self._agent.act(self._seen)

    def preview(self, choice: Ints) -> Action:
        """The action of the frame after these choices [M], which are not taken."""
        shared = {id(part): part for part in (self._task, self._seen)}
        return copy.deepcopy(self, shared).act(choice)

    def _resolved(self, choice: Ints) -> tuple[Ints, Ints]:
        """Detections that join a track, and the slot of each, or FREE."""
        new = np.flatnonzero(choice == NEW)
        continuing = np.flatnonzero(choice >= CONTINUE)
        rank = choice[continuing] - CONTINUE
        slot, distance = self._order[continuing, rank], self._distance[continuing, rank]
        by_distance = np.argsort(distance, kind="stable")  # inf: no such track
        _, first = np.unique(slot[by_distance], return_index=True)
        winner = by_distance[first]
        winner = winner[np.isfinite(distance[winner])]
        rows = self._rows[np.concatenate([new, continuing[winner]])]
        return rows, np.concatenate([np.full(len(new), FREE), slot[winner]])
