"""Tracks of training scenes, beside whether their object is there: what presence is fitted on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

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
from ..types import Bools, Scene, Task, joined, select
from .motion_windows import observations
from .split import SceneChoice

MOST_ROWS = 40_000  # neighbouring frames are nearly the same: every second or third is enough


@dataclass(frozen=True)
class PresenceRecipe:
    """How the presence of a detector is fitted: the table [presence] of its file."""

    scenes: tuple[SceneChoice, ...]
    features: tuple[str, ...] = tuple(FEATURES)
    products: bool = True  # of two features
    calibrated: bool = True
    terms: str = ""  # of the data
    like: str | None = None  # a detector whose model it takes: its scores stand for those of equal rank

    @classmethod
    def of(cls, detector: str) -> PresenceRecipe:
        """The recipe of a detector; raises UnknownNameError if its training scenes are not known."""
        table: Mapping[str, Any] | None = (read_detector(detector) or {}).get("presence")
        if table is None:
            raise UnknownNameError("detector", detector, detector_names())
        scenes = tuple(SceneChoice(**{**row, "without": tuple(row.get("without", ()))}) for row in table["scenes"])
        features = tuple(table.get("features", FEATURES))
        return cls(**{**table, "scenes": scenes, "features": features})

    def choices(self, detector: str) -> tuple[SceneChoice, ...]:
        """The scenes to read: of a detector like another one, those of both."""
        if self.like is None:
            return self.scenes
        return tuple(replace(self.scenes[0], detector=name) for name in (detector, self.like))


@dataclass(frozen=True, eq=False)
class Rows(TrackHistory):
    """Tracks of n frames and tracks in all, and whether an object was there."""

    class_name: Any  # [n] str
    present: Bools  # [n]
    scene: Any  # [n] str: rows of one scene are never on both sides of a split


def collect(scenes: Iterable[Scene], card: Card, task: Task) -> Rows:
    """The tracks of the single-hypothesis tracker; a track on a neutral object is neither and left out.

    An object is there if the track is matched to it by the rule for forecasts: one to one, within the forecast gate.
    """
    parts = [_scene_rows(scene, card, task) for scene in scenes]
    if not any(len(part.present) for part in parts):
        raise MtpBenchError(f"{card.id}: no track in any training scene, so there is nothing to fit")
    return joined(parts)


def _scene_rows(scene: Scene, card: Card, task: Task) -> Rows:
    tracker = HypothesisTracker()
    tracker.reset(task)
    said: list[tuple[Tracks, TrackHistory]] = []
    for t, observation in enumerate(observations(scene)):
        tracks = tracker.step(observation)
        said.append((tracks, history_of(tracks, {"ego_pose": scene.ego[t]}, task.dt)))
    frame = np.repeat(np.arange(len(said)), [len(tracks.box) for tracks, _ in said])
    box, class_id = (np.concatenate([getattr(tracks, key) for tracks, _ in said]) for key in ("box", "class_id"))
    truth = evaluated(scene).truth
    found = match_objects(truth, frame, box, class_id, card)
    present = np.zeros(len(frame), dtype=bool)
    row = found.object_of_truth[~truth.neutral]
    present[row[row >= 0]] = True
    kept = present | (found.unmatched & ~neutral_places(scene, frame, box[:, :2], class_id))
    history, names = joined([one for _, one in said]), np.array(task.classes)[class_id]
    rows = Rows(**vars(history), class_name=names, present=present, scene=np.full(len(frame), scene.name))
    return select(rows, kept)


def training_rows(recipe: PresenceRecipe, options: RunOptions = DEFAULTS) -> tuple[Rows, list[dict[str, Any]]]:
    """The rows of a recipe, and which scenes they are from."""
    parts, origin = [], []
    for wanted in recipe.scenes:
        split = wanted.open(options)
        parts.append(collect(split.scenes(), split.card, MTPEnv(split.card, data=options.data).task))
        said = {"env": wanted.env, "split": wanted.split, "detector": split.card.detector_name}
        origin.append({**said, "scenes": list(split.names)})
    return joined(parts), origin


def thinned(rows: Rows) -> Rows:
    """Every so manieth row, such that there are at most MOST_ROWS."""
    n = len(rows.present)
    return select(rows, np.arange(0, n, -(-n // MOST_ROWS)))
