"""The operating point of an agent: from which score on a forecast is worth more than it costs.

A forecast of a target gains what its error is below the miss error c, a false forecast costs c/2 (protocol,
"missing-aware error"). Both are sums over forecasts, so the best least score of a class is where the sum from the top
is greatest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..agent import Action, Observation, Pipeline
from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError
from ..prediction import KinematicPredictor, KMeansSampler
from ..running.options import DEFAULTS, RunOptions
from ..running.run import run_scene
from ..scoring.definitions import FALSE_FORECAST_SHARE
from ..scoring.forecasts import forecast_errors, match_objects
from ..scoring.targets import find_targets
from ..tracking import HypothesisTracker
from ..types import Floats, Ints, Rollout, Scene
from .split import open_split


def fit_env(env_id: str, options: RunOptions = DEFAULTS) -> str:
    """TOML of the least score per class from which on it pays to report an object, on the training split of an env.

    The agent is the single-hypothesis pipeline. ``options`` may name another split. Raises MtpBenchError for whatever
    the user can mend, and where the truth is not complete: there no forecast costs anything.
    """
    split = open_split(env_id, options.on_split("train"))
    env = MTPEnv(split.card, data=options.data, evaluation=True)
    worth = []
    for name in split.watched():
        agent = Pipeline(HypothesisTracker(1), KinematicPredictor(), KMeansSampler())
        worth.append(worth_of_scene(agent, env, name))
        if not env.scene.truth_complete:
            raise MtpBenchError(f"{env_id}: the truth is not complete, so no false forecast costs anything")
    return as_toml(env_id, least_scores(worth, env.card.task.classes))


class Worth(NamedTuple):
    """Forecasts of a scene: class [F], mean score of the track [F] and what each is worth [F], metres."""

    class_id: Ints
    score: Floats
    gain: Floats


def worth_of_scene(agent: Pipeline, env: MTPEnv, scene_name: str, seed: int = 0) -> Worth:
    """What the forecasts of ``agent`` on one scene are worth."""
    watched = _Watched(agent)
    rollout = run_scene(watched, env, scene_name, seed)
    if rollout.invalid.any():
        raise MtpBenchError(f"{scene_name}: rows of the agent were taken out, so their scores cannot be told apart")
    score = np.concatenate([np.zeros(0), *watched.scores])
    return Worth(rollout.object_class, score, gains(env.scene, rollout, env.card))


def gains(scene: Scene, rollout: Rollout, card: Card) -> Floats:
    """Metres of missing-aware error [F] that every forecast object of a rollout saves; negative: costs."""
    worst = np.asarray(card.per_class(card.task.miss_error))
    targets, frame = find_targets(scene, card), rollout.objects.frame_of_rows
    found = match_objects(scene.truth, frame, rollout.object_box, rollout.object_class, card)
    error = forecast_errors(targets, found, rollout).min_ade
    gain = np.zeros(len(frame))
    if scene.truth_complete:
        gain[found.unmatched] = -FALSE_FORECAST_SHARE * worst[rollout.object_class[found.unmatched]]
    row = found.object_of_truth[targets.row]
    gain[row[row >= 0]] = np.maximum(worst[targets.class_id] - error, 0.0)[row >= 0]
    return gain


def least_scores(worth: Sequence[Worth], classes: Sequence[str]) -> dict[str, float]:
    """The best least score of each class that was forecast.

    inf where no forecast of the class is worth its cost, -inf where all of them together are.
    """
    class_id, score, gain = (np.concatenate(part) for part in zip(*worth, strict=True))
    return {
        name: _least_score(score[class_id == number], gain[class_id == number])
        for number, name in enumerate(classes)
        if (class_id == number).any()
    }


def as_toml(name: str, least: Mapping[str, float]) -> str:
    """The table of one env; rounded down, so that the forecasts it was fitted to stay in."""
    rows = [
        f"{key} = {value if np.isinf(value) else np.floor(value * 1000) / 1000:.3f}" for key, value in least.items()
    ]
    return "\n".join([f'["{name}"]', *rows, ""])


def _least_score(score: Floats, gain: Floats) -> float:
    """Where the sum of gains from the highest score down is greatest; forecasts of one score go together."""
    level, place = np.unique(-score, return_inverse=True)  # the highest first
    total = np.cumsum(np.bincount(place, gain))
    best = int(total.argmax())
    if total[best] <= 0:
        return np.inf
    return float(-level[best]) if best < len(level) - 1 else -np.inf


class _Watched:
    """An agent that notes the scores of what it reports."""

    def __init__(self, agent: Pipeline) -> None:
        self._agent = agent
        self.scores: list[Floats] = []
        self.reset = agent.reset

    def act(self, observation: Observation) -> Action:
        action = self._agent.act(observation)
        assert self._agent.reported is not None
        self.scores.append(self._agent.reported.score)
        return action
