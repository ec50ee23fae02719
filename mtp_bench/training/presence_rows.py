"""Training rows of the presence model: tracks of training scenes, and whether a true object was there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..agent import Tracker
from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError, UnknownNameError
from ..prediction.presence import FEATURES, TrackHistory, history_of
from ..running.options import DEFAULTS, RunOptions
from ..scoring.forecasts import match_objects
from ..scoring.neutral import evaluated, neutral_places
from ..tracking import HypothesisTracker
from ..tracking.parameters import detector_names, read_detector
from ..tracks import Tracks
from ..types import Bools, Floats, Ints, Scene, Task, joined, select
from .split import SceneChoice, observations

MOST_ROWS = 40_000  # neighbouring frames are nearly the same: every second or third is enough


@dataclass(frozen=True)
class PresenceRecipe:
    """Recipe to fit the presence model of a detector: the table [presence] of the detector's file."""

    scenes: tuple[SceneChoice, ...]
    features: tuple[str, ...] = tuple(FEATURES)
    products: bool = True  # of two features
    calibrated: bool = True
    terms: str = ""  # of the data
    like: str | None = None  # a detector whose model it takes: its scores stand for those of equal rank

    @classmethod
    def of(cls, detector: str) -> PresenceRecipe:
        """The recipe of a detector; raises UnknownNameError for a detector without one."""
        table: Mapping[str, Any] | None = (read_detector(detector) or {}).get("presence")
        if table is None:
            raise UnknownNameError("detector", detector, detector_names())
        scenes = tuple(SceneChoice(**{**row, "without": tuple(row.get("without", ()))}) for row in table["scenes"])
        features = tuple(table.get("features", FEATURES))
        return cls(**{**table, "scenes": scenes, "features": features})

    def choices(self, detector: str) -> tuple[SceneChoice, ...]:
        """The scenes to read; if the model of ``like`` is taken, the first choice with each of both detectors."""
        if self.like is None:
            return self.scenes
        return tuple(replace(self.scenes[0], detector=name) for name in (detector, self.like))


@dataclass(frozen=True, eq=False)
class PresenceRows(TrackHistory):
    """Histories of n tracks in frames, and whether their object was there."""

    class_name: Any  # [n] str
    present: Bools  # [n]
    scene: Any  # [n] str: rows of one scene are never on both sides of a split


class MatchedTracks(NamedTuple):
    """All R tracks of a tracker on a scene, frame after frame, matched to the truth by the rule for forecasts."""

    by_frame: list[Tracks]
    frame: Ints  # [R]
    box: Floats  # [R, 7]
    class_id: Ints  # [R]
    track_id: Ints  # [R]
    object_row: Ints  # [X] the track of each evaluated true box, -1: none
    false: Bools  # [R] of no object, and not in a neutral place


def match_tracks(scene: Scene, card: Card, task: Task, tracker: Tracker) -> MatchedTracks:
    """Run ``tracker`` on a scene and match its tracks one to one with true objects, within the forecast gate."""
    tracker.reset(task)
    by_frame = [tracker.step(observation) for observation in observations(scene)]
    frame = np.repeat(np.arange(len(by_frame)), [len(tracks.box) for tracks in by_frame])
    box, class_id, track_id = (
        np.concatenate([getattr(tracks, key) for tracks in by_frame]) for key in ("box", "class_id", "track_id")
    )
    truth = evaluated(scene).truth
    matching = match_objects(truth, frame, box, class_id, card)
    false = matching.unmatched & ~neutral_places(evaluated(scene), frame, box[:, :2], class_id)
    row = matching.object_of_truth[~truth.neutral]
    return MatchedTracks(by_frame, frame, box, class_id, track_id, row, false)


def collect(scenes: Iterable[Scene], card: Card, task: Task) -> PresenceRows:
    """Rows of the single-hypothesis tracker; tracks on neutral objects and in neutral places are left out."""
    parts = [_scene_rows(scene, card, task) for scene in scenes]
    if not any(len(part.present) for part in parts):
        raise MtpBenchError(f"{card.id}: no track in any training scene, so there is nothing to fit")
    return joined(parts)


def _scene_rows(scene: Scene, card: Card, task: Task) -> PresenceRows:
    tracks = match_tracks(scene, card, task, HypothesisTracker())
    poses = [{"ego_pose": pose} for pose in scene.ego]
    history = joined([history_of(*pair, task.dt) for pair in zip(tracks.by_frame, poses, strict=True)])
    present = np.zeros(len(tracks.frame), dtype=bool)
    present[tracks.object_row[tracks.object_row >= 0]] = True
    names, scene_name = np.array(task.classes)[tracks.class_id], np.full(len(present), scene.name)
    rows = PresenceRows(**vars(history), class_name=names, present=present, scene=scene_name)
    return select(rows, present | tracks.false)


def training_rows(recipe: PresenceRecipe, options: RunOptions = DEFAULTS) -> tuple[PresenceRows, list[dict[str, Any]]]:
    """The rows of a recipe, and the scenes they are from."""
    parts, origin = [], []
    for choice in recipe.scenes:
        split = choice.open(options)
        parts.append(collect(split.scenes(), split.card, MTPEnv(split.card, data=options.data).task))
        source = {"env": choice.env, "split": choice.split, "detector": split.card.detector_name}
        origin.append({**source, "scenes": list(split.names)})
    return joined(parts), origin


def thinned(rows: PresenceRows) -> PresenceRows:
    """Every n-th row, so that at most MOST_ROWS are left."""
    n = len(rows.present)
    return select(rows, np.arange(0, n, -(-n // MOST_ROWS)))
