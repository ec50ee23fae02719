"""Tracks with external association, in a fixed number of slots."""

import numpy as np

from ..tracks import UNBORN, Tracks
from ..types import Floats, Ints, Observation, Task

FREE = -1  # identity of a slot without a track; as a slot: a new track


class Slots:
    """A `Tracker` of one hypothesis whose detections are assigned to tracks by `choose` before each frame.

    A track without a detection keeps its velocity, and ends after more than ``patience`` frames in a row without one.
    ``slots``: number of tracks at a time; no track begins if none is free.
    """

    def __init__(self, slots: int, patience: int) -> None:
        self._slots, self._patience = slots, patience

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._next = 0
        self.begin(task)

    def begin(self, task: Task) -> None:
        """Begin a scene, or what follows a hole in time: without tracks."""
        n, past = self._slots, task.past
        self.identity = np.full(n, FREE)  # [N]
        self.class_id = np.zeros(n, dtype=np.int64)  # [N]
        self.unseen, self._age = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)  # [N] frames
        self.hits = np.zeros(n, dtype=np.int64)  # [N] detections
        self._score, self._last_score = np.zeros(n), np.zeros(n)  # [N] sum, and that of the last one
        self._past, self._taken = np.zeros((n, past, 7)), np.full((n, past), UNBORN)  # the last row is the last frame
        self.choose(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))

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
        self._past, self._taken = np.roll(self._past, -1, axis=1), np.roll(self._taken, -1, axis=1)
        self._past[:, -1], self._taken[:, -1] = expected, -1
        self._age += 1
        self.unseen += 1
        self._begin(slots[self.identity[slots] == FREE])
        self._take(slots, rows, observation)
        self.identity[self.unseen > self._patience] = FREE
        return self._tracks()

    def _begin(self, slots: Ints) -> None:
        """Begin tracks without a past in these slots."""
        self.identity[slots] = self._next + np.arange(len(slots))
        self._next += len(slots)
        self._past[slots], self._taken[slots] = 0.0, UNBORN
        self.hits[slots], self._age[slots], self._score[slots] = 0, 1, 0.0

    def _take(self, slots: Ints, rows: Ints, observation: Observation) -> None:
        """Add the detections ``rows`` to the tracks in the ``slots``."""
        self._past[slots, -1], self._taken[slots, -1] = observation["detection_box"][rows], rows
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
