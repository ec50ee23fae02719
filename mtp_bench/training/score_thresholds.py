"""Choice of score thresholds: the least score of detections to track, per class.

By MOTA of the single-hypothesis tracker on training scenes, per class:
1 - (false positives + misses + switches) / true boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError
from ..prediction.presence import file_of, read_model
from ..running.options import DEFAULTS, RunOptions
from ..scoring.forecasts import match_objects
from ..scoring.neutral import evaluated
from ..tracking import HypothesisTracker
from ..types import Floats, Ints, Scene, Task
from .presence_rows import PresenceRecipe, match_tracks
from .split import SceneChoice

QUANTILES = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)  # of the scores of detections of true objects
LEAST_TRUTH = 200  # true boxes of a class, below which it gets no threshold


@dataclass(frozen=True)
class Counts:
    """Errors of the tracker for one class over training scenes, with one threshold."""

    threshold: float
    truth: int
    false: int
    missed: int
    switches: int

    @property
    def mota(self) -> float:
        """Multi-object tracking accuracy."""
        return 1 - (self.false + self.missed + self.switches) / max(self.truth, 1)


def fit_detector(detector: str, options: RunOptions = DEFAULTS) -> str:
    """The table [min_detection_score] of a detector's file, as `mtp_bench.tracking.score_thresholds` reads it.

    A detector that takes the presence of another one takes its thresholds too, at scores of equal rank.
    """
    like = PresenceRecipe.of(detector).like
    if like is None:
        return as_toml(best_thresholds(detector, options))
    _, tables = read_model(file_of(detector))
    best = {name: score for name, score in best_thresholds(like, options).items() if name in tables}
    return as_toml({name: float(np.interp(score, *tables[name][::-1])) for name, score in best.items()})


@dataclass(frozen=True, eq=False)
class TrainingScenes:
    """Training scenes of one env."""

    scenes: Sequence[Scene]
    card: Card
    task: Task


def best_thresholds(detector: str, options: RunOptions = DEFAULTS) -> dict[str, float]:
    """The threshold of each class with the greatest MOTA; classes that are best without one are left out."""
    envs = [_open(choice, options) for choice in PresenceRecipe.of(detector).scenes]
    best = {}
    for name, tried in try_thresholds(envs).items():
        top = max(tried, key=lambda counts: counts.mota)
        if tried[0].truth >= LEAST_TRUTH and top.mota > tried[0].mota:
            best[name] = top.threshold
    return best


def _open(choice: SceneChoice, options: RunOptions) -> TrainingScenes:
    split = choice.open(options)
    scenes = list(split.scenes())
    if not all(scene.truth_complete for scene in scenes):
        raise MtpBenchError(f"{choice.env}: the truth is not complete, so false positives are unknown")
    return TrainingScenes(scenes, split.card, MTPEnv(split.card, data=options.data).task)


def try_thresholds(envs: Sequence[TrainingScenes]) -> dict[str, list[Counts]]:
    """Counts with a threshold at each of QUANTILES, by class name; the first is without one."""
    scores: dict[str, list[Floats]] = {}
    for env in envs:
        for name, own in zip(env.task.classes, _true_scores(env), strict=True):
            scores.setdefault(name, []).append(own)
    joined = {name: np.concatenate(parts) for name, parts in scores.items()}
    tried: dict[str, list[Counts]] = {name: [] for name in joined}
    for quantile in QUANTILES:
        threshold = {
            name: float(f"{np.quantile(own, quantile):.3g}") if quantile and len(own) else -np.inf
            for name, own in joined.items()
        }
        total = {name: np.zeros(4, dtype=np.int64) for name in joined}
        for env in envs:
            names = env.task.classes
            tracker = HypothesisTracker(min_detection_score={name: threshold[name] for name in names})
            for scene in env.scenes:
                for name, row in zip(names, _count(scene, env, tracker), strict=True):
                    total[name] += row
        for name, row in total.items():
            tried[name].append(Counts(threshold[name], *row.tolist()))
    return tried


def as_toml(thresholds: dict[str, float]) -> str:
    """The text of the table."""
    return "\n".join(["[min_detection_score]", *(f"{name} = {score:.3g}" for name, score in thresholds.items()), ""])


def _true_scores(env: TrainingScenes) -> list[Floats]:
    """Scores of the detections of true objects, by class."""
    parts: list[list[Floats]] = [[] for _ in env.task.classes]
    for scene in map(evaluated, env.scenes):
        seen = scene.detections
        matching = match_objects(scene.truth, seen.frame_of_rows, seen.box, seen.class_id, env.card)
        row = matching.object_of_truth[~scene.truth.neutral]
        row = row[row >= 0]
        for number, part in enumerate(parts):
            part.append(seen.score[row[seen.class_id[row] == number]])
    return [np.concatenate(part) for part in parts]


def _count(scene: Scene, env: TrainingScenes, tracker: HypothesisTracker) -> Ints:
    """True boxes, false positives, misses and switches of each class [C, 4]."""
    tracks = match_tracks(scene, env.card, env.task, tracker)
    truth = evaluated(scene).truth
    true_class, object_id = truth.class_id[~truth.neutral], truth.object_id[~truth.neutral]
    matched = tracks.object_row >= 0
    order = np.argsort(object_id[matched], kind="stable")  # frames stay in order
    same = np.diff(object_id[matched][order]) == 0
    other_track = np.diff(tracks.track_id[tracks.object_row[matched]][order]) != 0
    switched = true_class[matched][order][1:][same & other_track]
    counted = (true_class, tracks.class_id[tracks.false], true_class[~matched], switched)
    return np.stack([np.bincount(ids, minlength=len(env.task.classes)) for ids in counted], axis=1)
