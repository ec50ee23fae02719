"""Tracking by the true identities: the ideal past that prediction benchmarks assume."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..agent import Observation, Tracks
from ..errors import SubmissionError
from ..tracks import UNBORN
from ..types import Floats, Ints, Task


class TruthTracker:
    """One hypothesis made of true boxes and ids; needs an env with ``observe="truth"``."""

    def reset(self, task: Task) -> None:
        """Forget everything."""
        if task.observe != "truth":
            raise SubmissionError(f'TruthTracker needs an env made with observe="truth", got observe={task.observe!r}')
        self._frames: deque[tuple[Ints, Floats]] = deque(maxlen=task.past)

    def step(self, observation: Observation) -> Tracks:
        """The true objects of this frame with their true pasts."""
        valid = np.asarray(observation["detection_valid"]).astype(bool)
        box = np.asarray(observation["detection_box"], dtype=np.float64)[valid]
        ids = np.asarray(observation["detection_id"], dtype=np.int64)[valid]
        self._frames.append((ids, box))
        length = self._frames.maxlen or 1
        past = np.zeros((len(ids), length, 7))
        taken = np.full((len(ids), length), UNBORN)
        for back, (then_ids, then_box) in enumerate(reversed(self._frames)):
            mine, then = np.nonzero(ids[:, None] == then_ids[None, :])
            past[mine, length - 1 - back] = then_box[then]
            taken[mine, length - 1 - back] = then
        taken[(np.maximum.accumulate(taken, axis=1) >= 0) & (taken < 0)] = -1  # hidden for a while
        return Tracks(
            track_id=ids,
            box=box,
            class_id=np.asarray(observation["detection_class"], dtype=np.int64)[valid],
            score=np.asarray(observation["detection_score"], dtype=np.float64)[valid],
            detection=np.arange(len(ids)),
            past=past,
            past_valid=taken >= 0,
            member=np.ones((1, len(ids)), dtype=bool),
            log_weight=np.zeros(1),
            parent=np.zeros(1, dtype=np.int64),
            past_detection=taken,
        )
