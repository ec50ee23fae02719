"""Envs whose agent only assigns detections to tracks.

`AssociationOnly` takes those of a frame at once, `PerDetection` one per step.
"""

import copy
import reprlib
from typing import Any, SupportsFloat, final

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..agent import Predictor, Presence
from ..core import Action, ActionError, Ints, MtpBenchError, Observation
from ..env import MTPEnv
from .associator import CONTINUE, MAX_TRACKS, Associator, Numbers, nearest


@final
class AssociationOnly(
    gymnasium.Wrapper[Numbers, Ints, Observation, Action], RecordConstructorArgs
):
    """The agent only associates: the tracks are kept and forecast for it.

    The action is a MultiDiscrete: for each of the M detections of the frame with the
    highest scores, in that order, 0 (ignore it), 1 (it begins a track) or 2 + i (it
    continues the i-th nearest of the tracks of its class that are expected less than
    ``near`` metres away). If two detections choose the same track, the nearer one
    continues it and the other one is ignored. Choices of absent tracks or detections,
    and new tracks beyond 64, are ignored without an error. A track ends after more than
    two frames in a row without a detection, and at a hole in time. Forecasts end at the
    327 m that the env allows.

    The observation is one vector of numbers from -1 to 1. `table` cuts it into a row
    for each of the M detections:

    - 1 if it is present, else the row is 0; its score s as s / (1 + abs(s)); metres
      ahead of the platform and to its left, in units of 100
    - one column per class, 1 for its own
    - for each of the ``choices`` tracks that it may continue, the nearest first: 1 if
      it exists; its nearness, from 1 at the expected position to 0 at ``near`` metres;
      1 - 1 / n after n detections; the frames since the last one, in units of 3

    The reward is relative: that of the env less what the policy `nearest` has earned in
    the same frame, had it played the scene from its beginning.
    ``info["absolute_reward"]`` is the env's own. With ``target_frames`` the tracks
    begin in the frames before the first one, as `nearest` chooses.

    Args:
        env: The env to wrap.
        predictor: Forecasts the tracks; None: constant velocity
            (`mtp_bench.prediction.KinematicPredictor`).
        detections: M.
        choices: Number of nearest tracks that a detection chooses from.
        near: Metres beyond which a detection cannot continue a track.
        presence: Probability that a track's object exists; None: certain, so the agent
            alone decides.
        relative: False for the reward of the env, which takes less time in the first
            episode of a scene.

    Raises MtpBenchError for a size or a distance that is not above 0, for an env of
    another library, and around another wrapper that changes observations or actions.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, Action],
        predictor: Predictor | None = None,
        detections: int = 24,
        choices: int = 2,
        near: float = 10.0,
        presence: Presence | None = None,
        relative: bool = True,
    ) -> None:
        from ..prediction import KinematicPredictor

        _require_number("detections", detections, "whole")
        _require_number("choices", choices, "whole")
        _require_number("near", near, "finite")
        if choices > MAX_TRACKS:
            raise MtpBenchError(
                f"choices is {choices}, expected at most {MAX_TRACKS}, "
                "the number of tracks at a time (AssociationOnly)"
            )
        RecordConstructorArgs.__init__(
            self,
            predictor=predictor,
            presence=presence,
            relative=relative,
            detections=detections,
            choices=choices,
            near=near,
        )
        untyped: Any = env  # Gymnasium types the inner env like the outer one
        gymnasium.Wrapper.__init__(self, untyped)
        self._env = env
        self._inner = _inner_of(env)
        self._started = False
        if predictor is None:
            predictor = KinematicPredictor()
        # the first one keeps the tracks of the agent, the second one, for a relative
        # reward, those of the policy `nearest`
        self._player, self._rival = (
            Associator(
                self._inner.task,
                *copy.deepcopy((predictor, presence)),
                detections,
                choices,
                near,
            )
            for _ in range(2)
        )
        self._relative = relative
        # by scene: what `nearest` earned in each frame of an episode that has ended
        self._earned: dict[str, list[float]] = {}
        self.shape = self._player.shape  # shape of the table
        self.options = CONTINUE + choices  # number of choices per detection
        self.observation_space = gymnasium.spaces.Box(
            -1.0, 1.0, (self.shape[0] * self.shape[1],), np.float32
        )
        self.action_space = gymnasium.spaces.MultiDiscrete(
            np.full(detections, self.options)
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Return the first frame.

        There are no tracks in it unless the env has ``target_frames``.
        """
        observation, info = self._env.reset(seed=seed, options=options)
        self._started = True
        self._rewards: list[float] = []  # of `nearest` in this episode
        is_known = self._inner.scene_name in self._earned
        self._players = [self._player]
        if self._relative and not is_known:
            self._players.append(self._rival)
        for player in self._players:
            player.reset()
            for past in self._inner.past:
                player.look(past)
                player.act(player.nearest)
        return self._shown(observation), {**info, "absolute_reward": 0.0}

    def step(
        self, action: Ints
    ) -> tuple[Numbers, SupportsFloat, bool, bool, dict[str, Any]]:
        """Associate the detections that were shown, and show the next frame.

        Raises ActionError unless ``action`` is an array of choices, and ResetNeeded
        before the first `reset`.
        """
        if not self._started:
            raise ResetNeeded("no scene yet: call reset() first")
        env_action = self._player.act(self._read(action))
        nearest_reward = self._nearest_reward() if self._relative else 0.0
        self._rewards.append(nearest_reward)
        observation, env_reward, terminated, truncated, info = self._env.step(
            env_action
        )
        if terminated and not self._inner.varies:
            self._earned[self._inner.scene_name] = self._rewards
        info["absolute_reward"] = float(env_reward)
        reward = float(env_reward) - nearest_reward
        return self._shown(observation), reward, terminated, truncated, info

    def _nearest_reward(self) -> float:
        """Return what the policy `nearest` earns in this frame."""
        if self._rival in self._players:
            return self._inner.reward_of(self._rival.act(self._rival.nearest))
        return self._earned[self._inner.scene_name][len(self._rewards)]

    def reward_of(self, choice: Ints) -> float:
        """Return the env's reward of choices [M] that are not taken."""
        return self._inner.reward_of(self._player.preview(choice))

    def table(self, observation: Numbers) -> Numbers:
        """Return a row per detection [M, 4 + C + 4 choices]."""
        return observation.reshape(self.shape)

    def nearest(self, observation: Numbers) -> Ints:
        """Choose the nearest track [M], else a new one."""
        return nearest(observation.reshape(-1, self.shape[1]), self._inner.task)

    def _shown(self, observation: Observation) -> Numbers:
        tables = [player.look(observation) for player in self._players]
        return tables[0].ravel()

    def _read(self, action: Any) -> Ints:
        """Return the choices as an array.

        Raise ActionError for other values.
        """
        try:
            choice: NDArray[Any] = np.asarray(action)
        except ValueError:  # rows of different lengths
            choice = np.zeros(0)  # refused below
        if not self.action_space.contains(choice):
            shown = action.tolist() if isinstance(action, np.ndarray) else action
            expected = f"{self.shape[0]} whole numbers from 0 to {self.options - 1}"
            raise ActionError(
                f"the choices are {reprlib.repr(shown)}, expected {expected}"
            )
        return choice


def _require_number(name: str, value: object, kind: str) -> None:
    """Raise MtpBenchError unless ``value`` is a "whole" or "finite" number above 0."""
    kinds: tuple[type, ...] = (int, np.integer)
    if kind == "finite":
        kinds += (float, np.floating)
    if isinstance(value, kinds) and not isinstance(value, bool):
        number: Any = value
        if 0 < number < np.inf:
            return
    raise MtpBenchError(
        f"{name} is {value!r}, expected a {kind} number above 0 (AssociationOnly)"
    )


def _inner_of(env: gymnasium.Env[Any, Any]) -> MTPEnv:
    """Return the unwrapped ``env``.

    Raises MtpBenchError for an env of another library or with changed spaces.
    """
    inner = env.unwrapped
    if not isinstance(inner, MTPEnv):
        expected = 'one of mtp_bench, such as gym.make("MTP-Roundabout-v0")'
        raise MtpBenchError(
            f"the env is a {type(inner).__name__}, expected {expected} (AssociationOnly)"
        )
    for name in ("observation_space", "action_space"):
        space = getattr(env, name)
        if not isinstance(space, gymnasium.spaces.Dict):
            raise MtpBenchError(
                f"the {name} of the env is a {type(space).__name__}, "
                "expected the Dict that it has unwrapped (AssociationOnly)"
            )
    return inner


@final
class PerDetection(
    gymnasium.Wrapper[Numbers, np.int64, Numbers, Ints], RecordConstructorArgs
):
    """One detection of `AssociationOnly` per step.

    So one network decides for each detection alike. The observation is the detection's
    row of `AssociationOnly.table`, the action its choice. Detections come by falling
    score; a frame without one is a step whose row is 0 and whose choice is ignored.

    The reward of a step is what its choice changes in the reward of the frame, with
    `AssociationOnly.nearest` for the detections that follow: 0 for a choice that is the
    nearest. What earlier frames have changed comes with the last detection of a frame,
    so the rewards of a frame add up to that of `AssociationOnly`. That step also has
    the frame's ``info``; in all of them ``info["detection"]`` is the place of the
    detection that is shown.

    Args:
        env: The env to wrap.
    """

    def __init__(self, env: AssociationOnly) -> None:
        RecordConstructorArgs.__init__(self)
        untyped: Any = env  # Gymnasium types the inner env like the outer one
        gymnasium.Wrapper.__init__(self, untyped)
        self._env = env
        self._place = 0
        self._frame_reward = 0.0
        self.observation_space = gymnasium.spaces.Box(
            -1.0, 1.0, env.shape[1:], np.float32
        )
        self.action_space = gymnasium.spaces.Discrete(env.options)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Return the first detection of the first frame."""
        observation, info = self._env.reset(seed=seed, options=options)
        return self._begin(observation), {**info, "detection": 0}

    def step(
        self, action: np.int64
    ) -> tuple[Numbers, SupportsFloat, bool, bool, dict[str, Any]]:
        """Choose for the detection that was shown.

        Raises ActionError unless ``action`` is a choice.
        """
        if not self.action_space.contains(action):
            expected = f"a whole number from 0 to {self._env.options - 1}"
            raise ActionError(f"the choice is {action!r}, expected {expected}")
        reward = 0.0
        earlier_choice = self._choice.copy()
        self._choice[self._place] = action
        self._place += 1
        detection_count = self._table[:, 0].sum()  # column 0: 1 if it is present
        if self._place < detection_count:
            if (self._choice != earlier_choice).any():
                reward = self._worth(self._choice) - self._worth(earlier_choice)
            self._frame_reward += reward
            info = {"detection": self._place}
            return self._table[self._place], reward, False, False, info
        observation, env_reward, terminated, truncated, info = self._env.step(
            self._choice
        )
        reward = float(env_reward) - self._frame_reward
        info = {**info, "detection": 0}
        return self._begin(observation), reward, terminated, truncated, info

    def nearest(self, observation: Numbers) -> np.int64:
        """Choose the nearest track if there is one, else a new one."""
        return np.int64(self._env.nearest(observation)[0])

    def _worth(self, choice: Ints) -> float:
        """Return the reward of the frame with these choices [M]."""
        key = choice.tobytes()
        if key not in self._worths:
            self._worths[key] = self._env.reward_of(choice)
        return self._worths[key]

    def _begin(self, observation: Numbers) -> Numbers:
        self._table = self._env.table(observation)
        self._choice = self._env.nearest(observation)
        self._place = 0
        self._frame_reward = 0.0
        self._worths: dict[bytes, float] = {}
        return np.asarray(self._table[0])
