"""The choice of score thresholds: the least score of detections that are tracked, per class.

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
from ..scoring.neutral import evaluated, neutral_places
from ..tracking import HypothesisTracker
from ..types import Floats, Ints, Scene, Task
from .motion_windows import observations
from .presence_rows import PresenceRecipe
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
class Drive:
    """Training scenes of one env."""

    scenes: Sequence[Scene]
    card: Card
    task: Task


def best_thresholds(detector: str, options: RunOptions = DEFAULTS) -> dict[str, float]:
    """The threshold of each class with the greatest MOTA; classes that are best without one are left out."""
    drives = [_drive(choice, options) for choice in PresenceRecipe.of(detector).scenes]
    best = {}
    for name, tried in try_thresholds(drives).items():
        top = max(tried, key=lambda counts: counts.mota)
        if tried[0].truth >= LEAST_TRUTH and top.mota > tried[0].mota:
            best[name] = top.threshold
    return best


def _drive(choice: SceneChoice, options: RunOptions) -> Drive:
    split = choice.open(options)
    scenes = list(split.scenes())
    if not all(scene.truth_complete for scene in scenes):
        raise MtpBenchError(f"{choice.env}: the truth is not complete, so false positives are unknown")
    return Drive(scenes, split.card, MTPEnv(split.card, data=options.data).task)


def try_thresholds(drives: Sequence[Drive]) -> dict[str, list[Counts]]:
    """Counts with a threshold at each of QUANTILES, by class name; the first is without one."""
    scores: dict[str, list[Floats]] = {}
    for drive in drives:
        for name, mine in zip(drive.task.classes, _true_scores(drive), strict=True):
            scores.setdefault(name, []).append(mine)
    joined = {name: np.concatenate(parts) for name, parts in scores.items()}
    tried: dict[str, list[Counts]] = {name: [] for name in joined}
    for quantile in QUANTILES:
        threshold = {
            name: float(f"{np.quantile(mine, quantile):.3g}") if quantile and len(mine) else -np.inf
            for name, mine in joined.items()
        }
        total = {name: np.zeros(4, dtype=np.int64) for name in joined}
        for drive in drives:
            names = drive.task.classes
            tracker = HypothesisTracker(min_detection_score={name: threshold[name] for name in names})
            for scene in drive.scenes:
                for name, row in zip(names, _count(scene, drive, tracker), strict=True):
                    total[name] += row
        for name, row in total.items():
            tried[name].append(Counts(threshold[name], *row.tolist()))
    return tried


def as_toml(thresholds: dict[str, float]) -> str:
    """The text of the table."""
    return "\n".join(["[min_detection_score]", *(f"{name} = {score:.3g}" for name, score in thresholds.items()), ""])


def _true_scores(drive: Drive) -> list[Floats]:
    """Scores of the detections of true objects, by class."""
    parts: list[list[Floats]] = [[] for _ in drive.task.classes]
    for scene in map(evaluated, drive.scenes):
        seen = scene.detections
        found = match_objects(scene.truth, seen.frame_of_rows, seen.box, seen.class_id, drive.card)
        row = found.object_of_truth[~scene.truth.neutral]
        row = row[row >= 0]
        for number, part in enumerate(parts):
            part.append(seen.score[row[seen.class_id[row] == number]])
    return [np.concatenate(part) for part in parts]


def _count(scene: Scene, drive: Drive, tracker: HypothesisTracker) -> Ints:
    """True boxes, false positives, misses and switches of each class [C, 4]."""
    tracker.reset(drive.task)
    said = [tracker.step(observation) for observation in observations(scene)]
    frame = np.repeat(np.arange(len(said)), [len(tracks.box) for tracks in said])
    box, class_id, track_id = (
        np.concatenate([getattr(tracks, key) for tracks in said]) for key in ("box", "class_id", "track_id")
    )
    scene = evaluated(scene)
    found = match_objects(scene.truth, frame, box, class_id, drive.card)
    false = found.unmatched & ~neutral_places(scene, frame, box[:, :2], class_id)
    true = ~scene.truth.neutral
    row, kind = found.object_of_truth[true], scene.truth.class_id[true]
    matched = row >= 0
    order = np.argsort(scene.truth.object_id[true][matched], kind="stable")  # frames stay in order
    thing, track = scene.truth.object_id[true][matched][order], track_id[row[matched]][order]
    switched = (thing[1:] == thing[:-1]) & (track[1:] != track[:-1])
    switches = np.bincount(kind[matched][order][1:][switched], minlength=len(drive.task.classes))
    counted = [np.bincount(ids, minlength=len(drive.task.classes)) for ids in (kind, class_id[false], kind[~matched])]
    return np.stack([*counted, switches], axis=1)
