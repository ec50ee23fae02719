"""Tracks from choices, in a fixed number of slots: a detection is ignored, begins a track or continues one near it."""

import copy

import numpy as np
from numpy.typing import NDArray

from ..agent import Pipeline, Predictor, Presence
from ..core import (
    NO_ROWS,
    UNBORN,
    Action,
    Floats,
    Ints,
    Observation,
    Task,
    Tracks,
    rotate,
)

Numbers = NDArray[
    np.float32
]  # from -1 to 1: an observation, the table of a frame, or a row of it
FREE = -1  # identity of a slot without a track; as a slot: a new track
IGNORE = 0  # the choice that leaves a detection out
NEW = 1  # the choice that begins a track
CONTINUE = 2  # CONTINUE + i: the choice of the i-th nearest track
MOST_TRACKS = 64  # at a time
_PATIENCE = 2  # frames without a detection before a track ends
_REACH = 100.0  # m; unit of observed positions
OWN, _OF_TRACK = (
    4,
    4,
)  # columns of a detection beside its class, and of each track near it


def nearest(table: Numbers, task: Task) -> Ints:
    """The obvious choices [M] of a table: the nearest track if there is one, else a new one."""
    return np.where(table[:, OWN + len(task.classes)] > 0, CONTINUE, NEW)


class Associator:
    """Tracks of one scene and their forecasts, by the rules and with the table of `AssociationOnly`."""

    def __init__(
        self,
        task: Task,
        predictor: Predictor,
        presence: Presence | None,
        rows: int,
        choices: int,
        near: float,
    ) -> None:
        from ..prediction import KMeansSampler

        self._task, self._choices, self._near = task, choices, near
        self.shape = rows, OWN + len(task.classes) + _OF_TRACK * choices  # of the table
        self._slots = Slots()
        self._agent = Pipeline(
            self._slots, predictor, KMeansSampler(), presence=presence
        )

    def reset(self) -> None:
        """Begin a scene."""
        self._agent.reset(self._task)

    def look(self, observation: Observation) -> Numbers:
        """The table of a frame, and the tracks that its detections may continue."""
        self._seen, slots = observation, self._slots
        if self._task.after_hole(observation):
            slots.begin(self._task)
        valid = np.flatnonzero(observation["detection_valid"])
        self._rows = valid[
            np.argsort(-observation["detection_score"][valid], kind="stable")
        ][: self.shape[0]]
        box, score = (
            observation["detection_box"][self._rows],
            observation["detection_score"][self._rows],
        )
        class_id, pose = (
            observation["detection_class"][self._rows],
            observation["ego_pose"],
        )
        distance = np.linalg.norm(
            box[:, None, :2] - slots.expected[None, :, :2], axis=2
        )
        distance[
            (class_id[:, None] != slots.class_id)
            | (slots.identity == FREE)
            | (distance >= self._near)
        ] = np.inf
        order = np.argsort(distance, axis=1, kind="stable")[:, : self._choices]
        self._distance = np.take_along_axis(distance, order, axis=1)
        self._order = np.where(
            np.isfinite(self._distance), order, FREE
        )  # [m, choices] slots
        exists, slot = self._order != FREE, self._order
        nearness = np.maximum(0, 1 - self._distance / self._near)
        certainty = 1 - 1 / np.maximum(slots.hits[slot], 1)
        waited = slots.unseen[slot] / (_PATIENCE + 1)
        columns = np.where(
            exists, np.stack([exists, nearness, certainty, waited]), 0
        ).transpose(1, 2, 0)
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
        return copy.deepcopy(
            self, {id(part): part for part in (self._task, self._seen)}
        ).act(choice)

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


class Slots:
    """A `Tracker` of one hypothesis whose detections are assigned to tracks by `choose` before each frame.

    A track without a detection keeps its velocity, and ends after more than _PATIENCE frames in a row without one.
    There are MOST_TRACKS slots; no track begins if none is free.
    """

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._next = 0
        self.begin(task)

    def begin(self, task: Task) -> None:
        """Begin a scene, or what follows a hole in time: without tracks."""
        n, past = MOST_TRACKS, task.past
        self.identity = np.full(n, FREE)  # [N]
        self.class_id = np.zeros(n, dtype=np.int64)  # [N]
        self.unseen, self._age = (
            np.zeros(n, dtype=np.int64),
            np.zeros(n, dtype=np.int64),
        )  # [N] frames
        self.hits = np.zeros(n, dtype=np.int64)  # [N] detections
        self._score, self._last_score = (
            np.zeros(n),
            np.zeros(n),
        )  # [N] sum, and that of the last one
        self._past, self._taken = (
            np.zeros((n, past, 7)),
            np.full((n, past), UNBORN),
        )  # the last row is the last frame
        self.choose(NO_ROWS, NO_ROWS)

    @property
    def expected(self) -> Floats:
        """Expected boxes [N, 7] of the tracks in the next frame, by their mean velocity over the stored past."""
        valid, last = self._taken >= 0, self._taken.shape[1] - 1
        first, latest = valid.argmax(axis=1), last - valid[:, ::-1].argmax(axis=1)
        slot = np.arange(len(valid))
        moved = self._past[slot, latest, :2] - self._past[slot, first, :2]
        box = self._past[:, -1].copy()
        box[:, :2] += moved / np.maximum(latest - first, 1)[:, None]
        return box

    def choose(self, rows: Ints, slots: Ints) -> None:
        """Assign the detections ``rows`` of the next frame to the tracks in ``slots``, FREE for new ones."""
        new = np.flatnonzero(slots == FREE)
        free = np.flatnonzero(self.identity == FREE)[: len(new)]
        self._rows, self._taking = rows, slots.copy()
        self._taking[new[: len(free)]] = free
        kept = self._taking != FREE
        self._rows, self._taking = self._rows[kept], self._taking[kept]

    def step(self, observation: Observation) -> Tracks:
        """Apply the assignment; the tracks after this frame."""
        slots, rows = self._taking, self._rows
        expected = self.expected
        self._past, self._taken = (
            np.roll(self._past, -1, axis=1),
            np.roll(self._taken, -1, axis=1),
        )
        self._past[:, -1], self._taken[:, -1] = expected, -1
        self._age += 1
        self.unseen += 1
        self._begin(slots[self.identity[slots] == FREE])
        self._take(slots, rows, observation)
        self.identity[self.unseen > _PATIENCE] = FREE
        return self._tracks()

    def _begin(self, slots: Ints) -> None:
        """Begin tracks without a past in these slots."""
        self.identity[slots] = self._next + np.arange(len(slots))
        self._next += len(slots)
        self._past[slots], self._taken[slots] = 0.0, UNBORN
        self.hits[slots], self._age[slots], self._score[slots] = 0, 1, 0.0

    def _take(self, slots: Ints, rows: Ints, observation: Observation) -> None:
        """Add the detections ``rows`` to the tracks in the ``slots``."""
        self._past[slots, -1], self._taken[slots, -1] = (
            observation["detection_box"][rows],
            rows,
        )
        self.class_id[slots] = observation["detection_class"][rows]
        self._last_score[slots] = observation["detection_score"][rows]
        self._score[slots] += self._last_score[slots]
        self.hits[slots] += 1
        self.unseen[slots] = 0

    def _tracks(self) -> Tracks:
        live = np.flatnonzero(self.identity != FREE)
        taken = self._taken[live]
        return Tracks.of_one_hypothesis(
            self.identity[live],
            self._past[live, -1],
            self.class_id[live],
            score=self._score[live] / self.hits[live],
            detection=taken[:, -1],
            past=self._past[live],
            past_valid=taken >= 0,
            parent=np.zeros(1, dtype=np.int64),
            last_score=self._last_score[live],
            hits=self.hits[live],
            age=self._age[live],
            past_detection=taken,
        )
