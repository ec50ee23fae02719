"""No objects and no forecasts: the lower reference of driving."""

import numpy as np

from mtp_bench import Action, Observation, Task, make_action


class Blind:
    """An agent that states no objects."""

    def __init__(self, task: Task) -> None:
        self._task = task

    def reset(self, task: Task) -> None:
        """Keep the task of the new scene."""
        self._task = task

    def act(self, observation: Observation) -> Action:
        """The action without objects."""
        return make_action(
            self._task, np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros((0, self._task.future, 2)), checked=False
        )
