"""Tracks from choices, in a fixed number of slots.

A detection is ignored, begins a track or continues one next to it.
"""

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

# from -1 to 1: an observation, the table of a frame, or a row of it
Numbers = NDArray[np.float32]
FREE = -1  # identity of a slot without a track; as a slot: none, as of a new track
IGNORE = 0  # the choice that leaves a detection out
NEW = 1  # the choice that begins a track
CONTINUE = 2  # CONTINUE + i: the choice of the i-th nearest track
MAX_TRACKS = 64  # at a time
_MAX_UNSEEN = 2  # frames without a detection before a track ends
_POSITION_UNIT = 100.0  # m
_DETECTION_COLUMNS = 4  # of a detection beside its class
_TRACK_COLUMNS = 4  # of each track next to it


def nearest(table: Numbers, task: Task) -> Ints:
    """Choose the nearest track [M], else a new one."""
    track_exists = table[:, _DETECTION_COLUMNS + len(task.classes)] > 0
    return np.where(track_exists, CONTINUE, NEW)


class Associator:
    """Tracks of one scene and their forecasts, by the rules of `AssociationOnly`."""

    def __init__(
        self,
        task: Task,
        predictor: Predictor,
        presence: Presence | None,
        rows: int,
        choices: int,
        max_distance_m: float,
    ) -> None:
        from ..prediction import KMeansSampler

        self._task = task
        self._choices = choices
        self._max_distance_m = max_distance_m
        columns = _DETECTION_COLUMNS + len(task.classes) + _TRACK_COLUMNS * choices
        self.shape = (rows, columns)  # of the table
        self._slots = Slots()
        self._agent = Pipeline(
            self._slots, predictor, KMeansSampler(), presence=presence
        )

    def reset(self) -> None:
        """Begin a scene."""
        self._agent.reset(self._task)

    def look(self, observation: Observation) -> Numbers:
        """Return the table of a frame."""
        self._observation = observation
        if self._task.after_hole(observation):
            self._slots.begin(self._task)
        valid = np.flatnonzero(observation["detection_valid"])
        by_score = np.argsort(-observation["detection_score"][valid], kind="stable")
        self._rows = valid[by_score][: self.shape[0]]
        box = observation["detection_box"][self._rows]
        score = observation["detection_score"][self._rows]
        class_id = observation["detection_class"][self._rows]
        pose = observation["ego_pose"]
        self._find_slots(box, class_id)
        table = np.zeros(self.shape)
        table[: len(box)] = np.concatenate(
            [
                np.ones((len(box), 1)),
                (score / (1 + np.abs(score)))[:, None],
                rotate(box[:, :2] - pose[:2], -float(pose[3])) / _POSITION_UNIT,
                class_id[:, None] == np.arange(len(self._task.classes)),
                self._track_columns(),
            ],
            axis=1,
        )
        clipped = np.clip(table, -1, 1).astype(np.float32)
        self.nearest = nearest(clipped, self._task)
        return clipped

    def _find_slots(self, box: Floats, class_id: Ints) -> None:
        """Find the nearest slots that detections [m] may continue, [m, choices].

        Sets `_nearest_slots`, FREE for a missing one, and `_nearest_m`.
        """
        slots = self._slots
        offset = box[:, None, :2] - slots.expected[None, :, :2]
        distance = np.linalg.norm(offset, axis=2)
        other_class = class_id[:, None] != slots.class_id
        too_far = distance >= self._max_distance_m
        distance[other_class | (slots.identity == FREE) | too_far] = np.inf
        order = np.argsort(distance, axis=1, kind="stable")[:, : self._choices]
        self._nearest_m = np.take_along_axis(distance, order, axis=1)
        self._nearest_slots = np.where(np.isfinite(self._nearest_m), order, FREE)

    def _track_columns(self) -> Floats:
        """Return the columns [m, 4 choices] of nearest tracks."""
        slots = self._slots
        slot = self._nearest_slots
        exists = slot != FREE
        nearness = np.maximum(0, 1 - self._nearest_m / self._max_distance_m)
        certainty = 1 - 1 / np.maximum(slots.hits[slot], 1)
        waited = slots.unseen[slot] / (_MAX_UNSEEN + 1)
        columns = np.stack([exists, nearness, certainty, waited])
        columns = np.where(exists, columns, 0).transpose(1, 2, 0)
        return columns.reshape(len(slot), _TRACK_COLUMNS * self._choices)

    def act(self, choice: Ints) -> Action:
        """Return the action of the frame after these choices [M]."""
        self._slots.choose(*self._resolve(choice[: len(self._rows)]))
        return self._agent.act(self._observation)

    def preview(self, choice: Ints) -> Action:
        """Return the action after choices that are not taken."""
        shared = {id(part): part for part in (self._task, self._observation)}
        return copy.deepcopy(self, shared).act(choice)

    def _resolve(self, choice: Ints) -> tuple[Ints, Ints]:
        """Return the detections that join tracks, and their slots or FREE."""
        new = np.flatnonzero(choice == NEW)
        continuing = np.flatnonzero(choice >= CONTINUE)
        rank = choice[continuing] - CONTINUE
        slot = self._nearest_slots[continuing, rank]
        distance = self._nearest_m[continuing, rank]
        # of the detections that choose a track, the nearest one continues it
        by_distance = np.argsort(distance, kind="stable")  # inf: no such track
        _, first = np.unique(slot[by_distance], return_index=True)
        winner = by_distance[first]
        winner = winner[np.isfinite(distance[winner])]
        rows = self._rows[np.concatenate([new, continuing[winner]])]
        return rows, np.concatenate([np.full(len(new), FREE), slot[winner]])


class Slots:
    """A `Tracker` of one hypothesis whose detections are assigned by `choose`.

    That happens before each frame. A track without a detection keeps its velocity, and
    ends after more than _MAX_UNSEEN frames in a row without one. There are MAX_TRACKS
    slots; no track begins if none is free.
    """

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._next = 0
        self.begin(task)

    def begin(self, task: Task) -> None:
        """Begin a scene, or what follows a hole in time: without tracks."""
        n = MAX_TRACKS
        self.identity = np.full(n, FREE)  # [N]
        self.class_id = np.zeros(n, dtype=np.int64)  # [N]
        self.unseen = np.zeros(n, dtype=np.int64)  # [N] frames
        self._age = np.zeros(n, dtype=np.int64)  # [N] frames
        self.hits = np.zeros(n, dtype=np.int64)  # [N] detections
        self._score_sum = np.zeros(n)  # [N]
        self._last_score = np.zeros(n)  # [N]
        # the last row is the last frame
        self._past = np.zeros((n, task.past, 7))
        self._detection = np.full((n, task.past), UNBORN)
        self.choose(NO_ROWS, NO_ROWS)

    @property
    def expected(self) -> Floats:
        """Expected boxes [N, 7] of the tracks in the next frame.

        They move by the mean velocity over the stored past.
        """
        valid = self._detection >= 0
        first = valid.argmax(axis=1)
        latest = valid.shape[1] - 1 - valid[:, ::-1].argmax(axis=1)
        slot = np.arange(len(valid))
        moved = self._past[slot, latest, :2] - self._past[slot, first, :2]
        box = self._past[:, -1].copy()
        box[:, :2] += moved / np.maximum(latest - first, 1)[:, None]
        return box

    def choose(self, rows: Ints, slots: Ints) -> None:
        """Assign the detections ``rows`` of the next frame to tracks in ``slots``.

        The slot of a new track is FREE. It gets a free one, if any is left.
        """
        new = np.flatnonzero(slots == FREE)
        free_slots = np.flatnonzero(self.identity == FREE)[: len(new)]
        chosen = slots.copy()
        chosen[new[: len(free_slots)]] = free_slots
        has_slot = chosen != FREE
        self._rows = rows[has_slot]
        self._chosen = chosen[has_slot]

    def step(self, observation: Observation) -> Tracks:
        """Apply the assignment and return the tracks after this frame."""
        slots = self._chosen
        expected = self.expected
        self._past = np.roll(self._past, -1, axis=1)
        self._detection = np.roll(self._detection, -1, axis=1)
        self._past[:, -1] = expected
        self._detection[:, -1] = -1
        self._age += 1
        self.unseen += 1
        self._begin(slots[self.identity[slots] == FREE])
        self._take(slots, self._rows, observation)
        self.identity[self.unseen > _MAX_UNSEEN] = FREE
        return self._tracks()

    def _begin(self, slots: Ints) -> None:
        """Begin tracks without a past in these slots."""
        self.identity[slots] = self._next + np.arange(len(slots))
        self._next += len(slots)
        self._past[slots] = 0.0
        self._detection[slots] = UNBORN
        self.hits[slots] = 0
        self._age[slots] = 1
        self._score_sum[slots] = 0.0

    def _take(self, slots: Ints, rows: Ints, observation: Observation) -> None:
        """Add the detections ``rows`` to the tracks in the ``slots``."""
        self._past[slots, -1] = observation["detection_box"][rows]
        self._detection[slots, -1] = rows
        self.class_id[slots] = observation["detection_class"][rows]
        self._last_score[slots] = observation["detection_score"][rows]
        self._score_sum[slots] += self._last_score[slots]
        self.hits[slots] += 1
        self.unseen[slots] = 0

    def _tracks(self) -> Tracks:
        live = np.flatnonzero(self.identity != FREE)
        detection = self._detection[live]
        return Tracks.of_one_hypothesis(
            self.identity[live],
            self._past[live, -1],
            self.class_id[live],
            score=self._score_sum[live] / self.hits[live],
            detection=detection[:, -1],
            past=self._past[live],
            past_valid=detection >= 0,
            parent=np.zeros(1, dtype=np.int64),
            last_score=self._last_score[live],
            hits=self.hits[live],
            age=self._age[live],
            past_detection=detection,
        )
