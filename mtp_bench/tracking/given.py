"""Tracking that was done elsewhere: the env feeds stored boxes with the ids of another program."""

from __future__ import annotations

import numpy as np

from ..agent import Observation, Tracks
from ..errors import SubmissionError
from ..types import Task
from .histories import Histories, Said


class GivenTracker:
    """One hypothesis made of stored tracks; needs an env with ``observe="tracks"``.

    A stored box counts as a detection that its track took, for the file does not say which boxes were measured.
    """

    def reset(self, task: Task) -> None:
        """Forget everything."""
        if task.observe != "tracks":
            raise SubmissionError(
                f'GivenTracker needs an env made with observe="tracks", got observe={task.observe!r}; '
                "name the stored tracks with --tracks"
            )
        self._histories = Histories(task.past)

    def step(self, observation: Observation) -> Tracks:
        """The stored tracks of this frame with their pasts."""
        rows = np.flatnonzero(np.asarray(observation["detection_valid"]))
        box = np.asarray(observation["detection_box"], dtype=np.float64)[rows]
        score = np.asarray(observation["detection_score"], dtype=np.float64)
        said = Said(
            track_id=np.asarray(observation["detection_id"], dtype=np.int64)[rows],
            box=box,
            class_id=np.asarray(observation["detection_class"], dtype=np.int64)[rows],
            score=score[rows],
            detection=rows,
            measured=box,
        )
        return self._histories.after(said, score)
