"""Fitting the parameters of baselines on the training split of an env."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..cards import changed_card, load_card
from ..env.environment import OBSERVE, MTPEnv
from ..errors import MtpBenchError, UnknownNameError
from ..sources import open_source

KINDS = ("motion-noise", "operating-point")


def fit_motion_noise(
    env_id: str,
    data: str | None = None,
    observe: str = "detections",
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
    scenes: int | None = None,
    changes: dict[str, Any] | None = None,
) -> str:
    """TOML of the motion noise fitted on the training split of ``env_id``, as ``mtp_bench.prediction`` stores it.

    On its first ``scenes`` scenes (None: all). ``changes`` are ``split``, ``detector`` and ``detection_file`` where
    they are not "train" and the card's.

    Raises MtpBenchError for whatever the user can mend, an empty training split among it.
    """
    from ..prediction.motion_noise import condition
    from .motion_noise import as_toml, fit_scenes

    if observe not in OBSERVE:
        raise UnknownNameError("value of observe", observe, OBSERVE)
    card = load_card(env_id)
    changes = {"split": "train", **(changes or {})}
    source = open_source(changed_card(card, **changes), data)
    names = source.names[:scenes]
    if not names:
        raise MtpBenchError(f"{env_id} has no scene in its split {changes['split']!r}")
    task = MTPEnv(env_id, data=data, observe=observe, **changes).task
    if started is not None:
        started(len(names))
    training = []
    for name in names:
        training.append(source.load(name))
        if progress is not None:
            progress(name)
    rows = fit_scenes(training, task)
    if not rows:
        raise MtpBenchError(
            f"{env_id}: no track of the {len(training)} training scenes follows an object with {task.future} future "
            "frames, so there is nothing to fit"
        )
    return as_toml(condition(task), rows)


def fit_operating_point(
    env_id: str,
    data: str | None = None,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
    scenes: int | None = None,
    changes: dict[str, Any] | None = None,
) -> str:
    """TOML of the least score per class from which on it pays to report an object, on the training split of an env.

    The agent is the single-hypothesis pipeline; arguments and errors as in `fit_motion_noise`. MtpBenchError, too,
    where the truth is not complete: there no forecast costs anything.
    """
    from ..agent import Pipeline
    from ..prediction import KinematicPredictor, KMeansSampler
    from ..tracking import HypothesisTracker
    from .operating_point import as_toml, least_scores, worth_of_scene

    changes = {"split": "train", **(changes or {})}
    env = MTPEnv(env_id, data=data, evaluation=True, **changes)
    names = env.scene_names[:scenes]
    if not names:
        raise MtpBenchError(f"{env_id} has no scene in its split {changes['split']!r}")
    if started is not None:
        started(len(names))
    worth = []
    for name in names:
        agent = Pipeline(HypothesisTracker(1), KinematicPredictor(), KMeansSampler())
        worth.append(worth_of_scene(agent, env, name))
        if not env.scene.truth_complete:
            raise MtpBenchError(f"{env_id}: the truth is not complete, so no false forecast costs anything")
        if progress is not None:
            progress(name)
    return as_toml(env_id, least_scores(worth, env.card.task.classes))
