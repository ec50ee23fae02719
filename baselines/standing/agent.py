"""Every detection stands still, with its score as the confidence: a lower reference of driving, without tracks."""

import numpy as np

from mtp_bench import Action, Observation, Task, make_action


class Standing:
    """An agent that states every detection as an object, with one forecast at its place."""

    def __init__(self, task: Task) -> None:
        self._task = task

    def reset(self, task: Task) -> None:
        """Keep the task of the new scene."""
        self._task = task

    def act(self, observation: Observation) -> Action:
        """The detections of this frame, each with one forecast of no motion."""
        rows = observation["detection_valid"].astype(bool)
        box = observation["detection_box"][rows]
        return make_action(
            self._task,
            box,
            observation["detection_class"][rows],
            np.zeros((len(box), self._task.future, 2)),
            confidence=np.clip(observation["detection_score"][rows], 0.0, 1.0),
            checked=False,
        )
