"""`PerDetection`: the agent assigns one detection per step."""

from typing import Any, SupportsFloat, final

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..errors import ActionError, describe_problem
from ..types import Ints
from .association import AssociationOnly

Row = NDArray[np.float32]


@final
class PerDetection(gymnasium.Wrapper[Row, np.int64, Row, Ints], RecordConstructorArgs):
    """One detection of `AssociationOnly` per step, so that one network decides for each detection alike.

    The observation is the detection's row of `AssociationOnly.table`, the action its choice. Detections come by falling
    score; a frame without one is a step whose row is 0 and whose choice is ignored.

    The reward of a step is what its choice changes in the reward of the frame, with `AssociationOnly.nearest` for the
    detections that follow: 0 for a choice that is the nearest. What earlier frames have changed comes with the last
    detection of a frame, so the rewards of a frame add up to that of `AssociationOnly`. That step also has the
    frame's ``info``; in all of them ``info["detection"]`` is the place of the detection that is shown.

    Args:
        env: The env to wrap.
    """

    def __init__(self, env: AssociationOnly) -> None:
        RecordConstructorArgs.__init__(self)
        untyped: Any = env  # Gymnasium types the inner env like the outer one
        gymnasium.Wrapper.__init__(self, untyped)
        self._env = env
        self._place, self._earned = 0, 0.0
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, env.shape[1:], np.float32)
        self.action_space = gymnasium.spaces.Discrete(env.options)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Row, dict[str, Any]]:
        """The first detection of the first frame."""
        observation, info = self._env.reset(seed=seed, options=options)
        return self._begin(observation), {**info, "detection": 0}

    def step(self, action: np.int64) -> tuple[Row, SupportsFloat, bool, bool, dict[str, Any]]:
        """Choose for the detection that was shown; ActionError unless ``action`` is a choice."""
        if not self.action_space.contains(action):
            expected = f"a whole number from 0 to {self._env.options - 1}"
            raise ActionError(describe_problem(f"the choice is {action!r}", expected))
        before, here = self._choice.copy(), self._place
        self._choice[here] = action
        if here + 1 < self._table[:, 0].sum():
            changed = self._choice[here] != before[here]
            earned = self._worth(self._choice) - self._worth(before) if changed else 0.0
            self._earned, self._place = self._earned + earned, here + 1
            return self._table[self._place], earned, False, False, {"detection": self._place}
        observation, reward, terminated, truncated, info = self._env.step(self._choice)
        reward = float(reward) - self._earned
        return self._begin(observation), reward, terminated, truncated, {**info, "detection": 0}

    def nearest(self, observation: Row) -> np.int64:
        """The obvious choice: the nearest track if there is one, else a new one."""
        return np.int64(self._env.nearest(observation)[0])

    def _worth(self, choice: Ints) -> float:
        """Reward of the frame with these choices [M]."""
        key = choice.tobytes()
        if key not in self._worths:
            self._worths[key] = self._env.reward_of(choice)
        return self._worths[key]

    def _begin(self, observation: Row) -> Row:
        """The first detection of a frame."""
        self._table, self._choice = self._env.table(observation), self._env.nearest(observation)
        self._place, self._earned, self._worths = 0, 0.0, dict[bytes, float]()
        return np.asarray(self._table[0])
