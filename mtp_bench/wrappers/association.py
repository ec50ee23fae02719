"""`AssociationOnly`: the agent says which detection belongs to which track, and the wrapper does the rest."""

from __future__ import annotations

import reprlib
from typing import Any, SupportsFloat, final

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from ..agent import Pipeline, Predictor, Presence
from ..errors import ActionError, MtpBenchError, sentence
from ..geometry import rotate
from ..types import Action, Floats, Ints, Observation
from .slots import FREE, Slots
from .wrapped import require_own_space, require_positive, task_of

IGNORE = 0  # the choice that leaves a detection out
NEW = 1  # the choice that begins a track
CONTINUE = 2  # CONTINUE + i: the choice of the i-th nearest track
_REACH = 100.0  # m; positions are told in it
_OWN, _OF_TRACK = 4, 4  # columns of a detection beside its class, and of each track near it
_STANDING, _PATIENCE = 64, 2  # tracks that there may be, frames without a detection after which one ends


@final
class AssociationOnly(gymnasium.Wrapper[NDArray[np.float32], Ints, Observation, Action], RecordConstructorArgs):
    """The agent only associates: the tracks are kept and forecast for it.

    The action is a MultiDiscrete: for each of the M surest detections of the frame, the surest first, 0 (ignore it),
    1 (it begins a track) or 2 + i (it continues the i-th nearest of the tracks of its class that are expected less than
    ``near`` metres away). Of two detections that are to continue the same track the nearer one does, and the other one
    is ignored. So is one that is to continue a track that is not there, a new one beyond 64 tracks, and whatever is
    said of detections that are not there. Nothing of this is an error. A track ends after more than two frames in a row
    without a detection. Forecasts end at the 327 m that the env allows.

    The observation is one vector of numbers from -1 to 1. `table` cuts it into a row for each of the M detections:

    - 1 if there is one, else the row is 0; its score s as s / (1 + abs(s)); metres ahead of the platform and to its
      left, in units of 100
    - one column per class, 1 for its own
    - for each of the ``choices`` tracks that it may continue, the nearest first: 1 if there is one; how near, from 1
      where the track is expected to 0 at ``near`` metres; 1 - 1 / n after n detections; the frames since the last one,
      in units of 3

    Args:
        env: The env to wrap.
        predictor: What forecasts the tracks; None: constant velocity (`mtp_bench.prediction.KinematicPredictor`).
        detections: M.
        choices: How many of the nearest tracks a detection chooses from.
        near: Metres from which on a detection cannot continue a track.
        presence: How likely it is that a track's object is there; None: certain, so the agent alone decides.

    Raises MtpBenchError for a size or a distance that is not above 0, for an env of another library, and around another
    wrapper that changes what is seen or answered.
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
            require_positive(name, value, "AssociationOnly", whole=name != "near")
        if choices > _STANDING:
            most = f"at most {_STANDING}, as many tracks as there may be"
            raise MtpBenchError(sentence(f"choices is {choices}", most, "AssociationOnly"))
        RecordConstructorArgs.__init__(self, predictor=predictor, presence=presence, **given)
        untyped: Any = env  # Gymnasium types the inner env like the outer one
        gymnasium.Wrapper.__init__(self, untyped)
        self._env, self._task, self._near = env, task_of(env, "AssociationOnly"), near
        require_own_space(env, "observation_space", "AssociationOnly")
        require_own_space(env, "action_space", "AssociationOnly")
        self._started = False
        self._slots = Slots(_STANDING, _PATIENCE)
        self._agent = Pipeline(self._slots, predictor or KinematicPredictor(), KMeansSampler(), presence=presence)
        self._choices = choices
        self._shape = detections, _OWN + len(self._task.classes) + _OF_TRACK * choices
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self._shape[0] * self._shape[1],), np.float32)
        self.action_space = gymnasium.spaces.MultiDiscrete(np.full(detections, CONTINUE + choices))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """The first frame; there is no track yet."""
        self._seen, info = self._env.reset(seed=seed, options=options)
        self._started = True
        self._agent.reset(self._task)
        return self._shown(), info

    def step(self, action: Ints) -> tuple[NDArray[np.float32], SupportsFloat, bool, bool, dict[str, Any]]:
        """Associate the detections that were shown, forecast the tracks, and show the next frame.

        Raises ActionError for what is no array of choices, and ResetNeeded before the first `reset`.
        """
        if not self._started:
            raise ResetNeeded("no scene yet: call reset() first")
        choice = self._read(action)
        self._slots.choose(*self._resolved(choice))
        answer = self._agent.act(self._seen)
        self._seen, reward, terminated, truncated, info = self._env.step(answer)
        return self._shown(), reward, terminated, truncated, info

    def table(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observation as one row per detection [M, 4 + C + 4 choices]."""
        return observation.reshape(self._shape)

    def nearest(self, observation: NDArray[np.float32]) -> Ints:
        """The obvious choices [M]: the nearest track if there is one, else a new one."""
        first = _OWN + len(self._task.classes)
        return np.where(self.table(observation)[:, first] > 0, CONTINUE, NEW)

    def _read(self, action: Any) -> Ints:
        """The choices as numbers; ActionError for anything else."""
        try:
            choice: NDArray[Any] = np.asarray(action)
        except ValueError:  # rows of different lengths
            choice = np.zeros(0)
        if not self.action_space.contains(choice):
            said = action.tolist() if isinstance(action, np.ndarray) else action
            expected = f"{self._shape[0]} whole numbers from 0 to {CONTINUE + self._choices - 1}"
            raise ActionError(sentence(f"the choices are {reprlib.repr(said)}", expected))
        return choice

    def _resolved(self, choice: Ints) -> tuple[Ints, Ints]:
        """The detections that belong to a track, and its slot or FREE; the rules of the class."""
        choice = choice[: len(self._rows)]
        new = np.flatnonzero(choice == NEW)
        place = np.flatnonzero(choice >= CONTINUE)
        rank = choice[place] - CONTINUE
        slot, apart = self._order[place, rank], self._apart[place, rank]
        by_distance = np.argsort(apart, kind="stable")  # inf: no such track
        _, first = np.unique(slot[by_distance], return_index=True)
        winner = by_distance[first]
        winner = winner[np.isfinite(apart[winner])]
        rows = self._rows[np.concatenate([new, place[winner]])]
        return rows, np.concatenate([np.full(len(new), FREE), slot[winner]])

    def _shown(self) -> NDArray[np.float32]:
        """The observation; keeps which detections it shows and which tracks are near them."""
        seen, slots, most = self._seen, self._slots, self._shape[0]
        there = np.flatnonzero(seen["detection_valid"])
        self._rows = there[np.argsort(-seen["detection_score"][there], kind="stable")][:most]
        box, score = seen["detection_box"][self._rows], seen["detection_score"][self._rows]
        class_id, pose = seen["detection_class"][self._rows], seen["ego_pose"]
        apart = np.linalg.norm(box[:, None, :2] - slots.expected[None, :, :2], axis=2)
        apart[(class_id[:, None] != slots.class_id) | (slots.identity == FREE) | (apart >= self._near)] = np.inf
        self._order = np.argsort(apart, axis=1, kind="stable")[:, : self._choices]  # [m, choices] slots
        self._apart = np.take_along_axis(apart, self._order, axis=1)
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
        """What is told of the nearest tracks [m, 4 choices]."""
        there, slot = np.isfinite(self._apart), self._order
        nearness = np.maximum(0, 1 - self._apart / self._near)
        known = 1 - 1 / np.maximum(self._slots.hits[slot], 1)
        waited = self._slots.unseen[slot] / (_PATIENCE + 1)
        columns = np.stack([np.ones(slot.shape), nearness, known, waited], axis=2)
        return np.asarray(np.where(there[:, :, None], columns, 0).reshape(len(slot), _OF_TRACK * self._choices))
