"""`AssociationOnly`: the agent assigns detections to tracks, and the wrapper does the rest."""

from __future__ import annotations

import reprlib
from typing import Any, SupportsFloat, final

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..agent import Pipeline, Predictor, Presence
from ..env import MTPEnv
from ..errors import ActionError, MtpBenchError, describe_problem
from ..geometry import rotate
from ..types import Action, Floats, Ints, Observation, Task
from .slots import FREE, Slots

IGNORE = 0  # the choice that leaves a detection out
NEW = 1  # the choice that begins a track
CONTINUE = 2  # CONTINUE + i: the choice of the i-th nearest track
_REACH = 100.0  # m; unit of observed positions
_OWN, _OF_TRACK = 4, 4  # columns of a detection beside its class, and of each track near it
_MOST_TRACKS, _PATIENCE = 64, 2  # tracks at a time; frames without a detection before a track ends


@final
class AssociationOnly(gymnasium.Wrapper[NDArray[np.float32], Ints, Observation, Action], RecordConstructorArgs):
    """The agent only associates: the tracks are kept and forecast for it.

    The action is a MultiDiscrete: for each of the M detections of the frame with the highest scores, in that order, 0
    (ignore it), 1 (it begins a track) or 2 + i (it continues the i-th nearest of the tracks of its class that are
    expected less than ``near`` metres away). If two detections choose the same track, the nearer one continues it and
    the other one is ignored. Choices of absent tracks or detections, and new tracks beyond 64, are ignored without an
    error. A track ends after more than two frames in a row without a detection, and at a hole in time. Forecasts end at
    the 327 m that the env allows.

    The observation is one vector of numbers from -1 to 1. `table` cuts it into a row for each of the M detections:

    - 1 if it is present, else the row is 0; its score s as s / (1 + abs(s)); metres ahead of the platform and to its
      left, in units of 100
    - one column per class, 1 for its own
    - for each of the ``choices`` tracks that it may continue, the nearest first: 1 if it exists; its nearness, from 1
      at the expected position to 0 at ``near`` metres; 1 - 1 / n after n detections; the frames since the last one, in
      units of 3

    Args:
        env: The env to wrap.
        predictor: Forecasts the tracks; None: constant velocity (`mtp_bench.prediction.KinematicPredictor`).
        detections: M.
        choices: Number of nearest tracks that a detection chooses from.
        near: Metres beyond which a detection cannot continue a track.
        presence: Probability that a track's object exists; None: certain, so the agent alone decides.

    Raises MtpBenchError for a size or a distance that is not above 0, for an env of another library, and around another
    wrapper that changes observations or actions.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, Action],
        predictor: Predictor | None = None,
        detections: int = 24,
        choices: int = 2,
        near: float = 10.0,
        presence: Presence | None = None,
    ) -> None:
        from ..prediction import KinematicPredictor, KMeansSampler

        given: dict[str, Any] = {"detections": detections, "choices": choices, "near": near}
        for name, value in given.items():
            _require_positive(name, value, whole=name != "near")
        if choices > _MOST_TRACKS:
            most = f"at most {_MOST_TRACKS}, the number of tracks at a time"
            raise MtpBenchError(describe_problem(f"choices is {choices}", most, "AssociationOnly"))
        RecordConstructorArgs.__init__(self, predictor=predictor, presence=presence, **given)
        untyped: Any = env  # Gymnasium types the inner env like the outer one
        gymnasium.Wrapper.__init__(self, untyped)
        self._env, self._task, self._near = env, _task_of(env), near
        self._started = False
        self._slots = Slots(_MOST_TRACKS, _PATIENCE)
        self._agent = Pipeline(self._slots, predictor or KinematicPredictor(), KMeansSampler(), presence=presence)
        self._choices = choices
        self._shape = detections, _OWN + len(self._task.classes) + _OF_TRACK * choices
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self._shape[0] * self._shape[1],), np.float32)
        self.action_space = gymnasium.spaces.MultiDiscrete(np.full(detections, CONTINUE + choices))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """The first frame, without tracks."""
        self._seen, info = self._env.reset(seed=seed, options=options)
        self._started = True
        self._agent.reset(self._task)
        return self._shown(), info

    def step(self, action: Ints) -> tuple[NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Associate the detections that were shown, forecast the tracks, and show the next frame.

        Raises ActionError unless ``action`` is an array of choices, and ResetNeeded before the first `reset`.
        """
        if not self._started:
            raise ResetNeeded("no scene yet: call reset() first")
        choice = self._read(action)
        self._slots.choose(*self._resolved(choice))
        whole = self._agent.act(self._seen)
        self._seen, reward, terminated, truncated, info = self._env.step(whole)
        if self._task.after_hole(self._seen):
            self._slots.begin(self._task)
        return self._shown(), reward, terminated, truncated, info

    def table(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observation as one row per detection [M, 4 + C + 4 choices]."""
        return observation.reshape(self._shape)

    def nearest(self, observation: NDArray[np.float32]) -> Ints:
        """The obvious choices [M]: the nearest track if there is one, else a new one."""
        first = _OWN + len(self._task.classes)
        return np.where(self.table(observation)[:, first] > 0, CONTINUE, NEW)

    def _read(self, action: Any) -> Ints:
        """The choices as an array; raises ActionError for other values."""
        try:
            choice: NDArray[Any] = np.asarray(action)
        except ValueError:  # rows of different lengths
            choice = np.zeros(0)
        if not self.action_space.contains(choice):
            shown = action.tolist() if isinstance(action, np.ndarray) else action
            expected = f"{self._shape[0]} whole numbers from 0 to {CONTINUE + self._choices - 1}"
            raise ActionError(describe_problem(f"the choices are {reprlib.repr(shown)}", expected))
        return choice

    def _resolved(self, choice: Ints) -> tuple[Ints, Ints]:
        """Detections that join a track by the rules of the class, and the slot of each, or FREE."""
        choice = choice[: len(self._rows)]
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

    def _shown(self) -> NDArray[np.float32]:
        """The observation; stores its detections and the tracks near them."""
        seen, slots, most = self._seen, self._slots, self._shape[0]
        valid = np.flatnonzero(seen["detection_valid"])
        self._rows = valid[np.argsort(-seen["detection_score"][valid], kind="stable")][:most]
        box, score = seen["detection_box"][self._rows], seen["detection_score"][self._rows]
        class_id, pose = seen["detection_class"][self._rows], seen["ego_pose"]
        distance = np.linalg.norm(box[:, None, :2] - slots.expected[None, :, :2], axis=2)
        distance[(class_id[:, None] != slots.class_id) | (slots.identity == FREE) | (distance >= self._near)] = np.inf
        self._order = np.argsort(distance, axis=1, kind="stable")[:, : self._choices]  # [m, choices] slots
        self._distance = np.take_along_axis(distance, self._order, axis=1)
        table = np.zeros(self._shape)
        table[: len(box)] = np.concatenate(
            [
                np.ones((len(box), 1)),
                (score / (1 + np.abs(score)))[:, None],
                rotate(box[:, :2] - pose[:2], -float(pose[3])) / _REACH,
                class_id[:, None] == np.arange(len(self._task.classes)),
                self._of_tracks(),
            ],
            axis=1,
        )
        return np.clip(table, -1, 1).astype(np.float32).ravel()

    def _of_tracks(self) -> Floats:
        """Columns of the nearest tracks [m, 4 choices]."""
        exists, slot = np.isfinite(self._distance), self._order
        nearness = np.maximum(0, 1 - self._distance / self._near)
        certainty = 1 - 1 / np.maximum(self._slots.hits[slot], 1)
        waited = self._slots.unseen[slot] / (_PATIENCE + 1)
        columns = np.stack([np.ones(slot.shape), nearness, certainty, waited], axis=2)
        return np.asarray(np.where(exists[:, :, None], columns, 0).reshape(len(slot), _OF_TRACK * self._choices))


def _task_of(env: gymnasium.Env[Any, Any]) -> Task:
    """The task of ``env``; raises MtpBenchError for an env of another library or with changed spaces."""
    inner = env.unwrapped
    if not isinstance(inner, MTPEnv):
        expected = 'one of mtp_bench, such as gym.make("MTP-Roundabout-v0")'
        raise MtpBenchError(describe_problem(f"the env is a {type(inner).__name__}", expected, "AssociationOnly"))
    for name in ("observation_space", "action_space"):
        space = getattr(env, name)
        if not isinstance(space, gymnasium.spaces.Dict):
            got, expected = f"the {name} of the env is a {type(space).__name__}", "the Dict that it has unwrapped"
            raise MtpBenchError(describe_problem(got, expected, "AssociationOnly"))
    return inner.task


def _require_positive(name: str, value: Any, whole: bool) -> None:
    """Raise MtpBenchError unless ``value`` is finite and above 0 (``whole``: an integer)."""
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, kinds) or not 0 < value < np.inf:
        expected = f"a {'whole' if whole else 'finite'} number above 0"
        raise MtpBenchError(describe_problem(f"{name} is {value!r}", expected, "AssociationOnly"))
