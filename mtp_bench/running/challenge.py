"""The nuScenes prediction challenge: score a submission, and write forecasts of a stored run as one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import Card
from ..errors import CardError, DataError
from ..files import require_file, whole_file
from ..parallel import NO_PROGRESS, Progress
from ..scoring import evaluated, find_targets, live_frames
from ..scoring.challenge import KS, challenge_errors
from ..scoring.forecasts import RecordedForecasts, candidates, match_by_confidence
from ..scoring.incremental_matching import final_match
from ..sources.nuscenes import NuScenesSource
from ..sources.nuscenes.challenge import FUTURE, Prediction, read_predictions, write_predictions
from ..sources.nuscenes.source import NuScenes
from ..types import Floats, Rollout, Scene
from .options import DEFAULTS, RunOptions
from .stored import OpenedRun

RATE = 2.0  # Hz
Name = tuple[str, str]  # tokens of instance and sample


@dataclass(frozen=True)
class ChallengeScore:
    """Metrics of the challenge for a file."""

    targets: int  # official ones of the split
    predicted: int  # of them
    elsewhere: int  # predictions of other objects: not scored
    metrics: dict[str, list[float | None]]  # mean over the predicted targets, for each of ``ks``
    ks: tuple[int, ...] = KS

    def to_json(self) -> dict[str, Any]:
        """Content of ``challenge --json``."""
        return {**vars(self), "ks": list(self.ks), "missing": self.targets - self.predicted}


@dataclass(frozen=True)
class Exported:
    """Numbers of an export."""

    targets: int  # official ones of the scenes that were run
    predicted: int  # those with a forecast


def score_predictions(path: str | Path, env_id: str, options: RunOptions = DEFAULTS) -> ChallengeScore:
    """The challenge's metrics of a submission to it, over the official targets of an env's split.

    ``env_id``: one with ``truth = "targets"``; ``options`` may name another split, and its first scenes. As in the
    devkit the means are over the predicted targets; missing ones are counted. Raises CardError for an env without
    official targets, DataError for a file that is invalid or predicts none of them.
    """
    path, future = Path(path), _official_futures(options.card(env_id), options)
    predictions = list(read_predictions(path))
    scored = [each for each in predictions if (each.instance, each.sample) in future]
    if not scored:
        raise DataError(
            f"{path}: none of its {len(predictions)} predictions is of one of the {len(future)} targets of this split; "
            "choose another with --split"
        )
    truth = [future[each.instance, each.sample] for each in scored]
    errors = challenge_errors([each.modes for each in scored], truth, [each.probability for each in scored])
    return ChallengeScore(len(future), len(scored), len(predictions) - len(scored), errors.means())


def export_predictions(opened: OpenedRun, path: str | Path, progress: Progress = NO_PROGRESS) -> Exported:
    """Write the forecasts of a stored run as a submission to the challenge; ``progress`` counts scenes.

    The forecast of a target is the one that the scorer matches to it when all are kept; a target without one is not in
    the file. Raises CardError for a run on an env without official targets.
    """
    path = Path(path).absolute()
    source = _source(opened.card, opened.data)
    require_file(path)
    progress.started(len(opened.run.rollouts))
    targets = 0

    def predictions() -> Iterator[Prediction]:
        nonlocal targets
        for rollout in opened.run.rollouts:
            names, matched = _matched(source, opened, rollout)
            targets += len(names)
            yield from matched
            progress.done(rollout.scene)

    with whole_file(path) as part, part.open("w", encoding="utf-8") as file:
        count = write_predictions(file, predictions())
    return Exported(targets, count)


def require_challenge(card: Card) -> None:
    """Raise CardError unless the card has the task of the challenge."""
    if not isinstance(card.source, NuScenesSource) or card.source.truth != "targets":
        raise CardError(
            f'{card.id} has no official prediction targets, expected a nuScenes env with truth = "targets", such as '
            "MTP-nuScenes-v0"
        )
    if card.task.future != FUTURE or card.task.rate != RATE:
        raise CardError(
            f"{card.id} forecasts {card.task.future} frames at {card.task.rate:g} Hz, expected {FUTURE} at {RATE:g} Hz "
            "as in the challenge"
        )


def _matched(source: NuScenes, opened: OpenedRun, rollout: Rollout) -> tuple[list[Name], list[Prediction]]:
    """The targets of a scene, and the predictions of those that have a forecast."""
    card, scene = opened.card, evaluated(opened.recorded(rollout.scene))
    targets, forecasts = find_targets(scene, card), RecordedForecasts.of(rollout)
    pairs = candidates(scene, targets, forecasts, live_frames(scene, card), card)
    matched = final_match(match_by_confidence(pairs, forecasts.confidence).additions, len(scene.truth.box))[targets.row]
    names = _target_names(source, scene, targets.object_id.tolist(), targets.frame.tolist())
    predictions = []
    for name, row in zip(names, matched.tolist(), strict=True):
        if row < 0:
            continue
        rows = np.array([row])
        weight, modes = forecasts.weights(rows)[0], forecasts.paths(rows)[0]
        present = weight > 0
        if present.any():
            predictions.append(Prediction(*name, modes[present], weight[present] / weight[present].sum()))
    return names, predictions


def _official_futures(card: Card, options: RunOptions) -> dict[Name, Floats]:
    """The true future [12, 2] of every official target of a card's scenes."""
    source = _source(card, options.data)
    future: dict[Name, Floats] = {}
    chosen = options.chosen(source.names)
    options.progress.started(len(chosen))
    for name in chosen:
        scene = source.load(name)
        targets = find_targets(scene, card)
        names = _target_names(source, scene, targets.object_id.tolist(), targets.frame.tolist())
        future.update(zip(names, targets.future, strict=True))
        options.progress.done(name)
    return future


def _target_names(source: NuScenes, scene: Scene, object_id: list[int], frame: list[int]) -> list[Name]:
    arrays = source.tables.arrays(scene.name)
    instance, sample = arrays["instance"], arrays["sample"]
    return [(str(instance[i]), str(sample[t])) for i, t in zip(object_id, frame, strict=True)]


def _source(card: Card, data: str | None) -> NuScenes:
    require_challenge(card)
    return NuScenes(card, data)
