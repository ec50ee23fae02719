"""Training rows of presence: tracks of training scenes, and what is true of them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from ..cards import Card
from ..core import Bools, MtpBenchError, Scene, Task, UnknownNameError, joined, select
from ..prediction import PRESENCE_FEATURES, Origin, TrackHistory, history_of
from ..running import DEFAULTS, RunOptions
from ..scoring import evaluated, match_objects, neutral_places
from ..tracking import HypothesisTracker, detector_names, read_detector
from .split import Split, observations, open_split

# rows that a fit takes, every n-th: neighbouring frames are nearly the same
MOST_ROWS = 40_000
FEW_SCENES = 4  # fewer are cut into blocks, so that some rows can be held out
BLOCK_SECONDS = 10.0


@dataclass(frozen=True)
class SceneChoice:
    """Scenes of an env, as the file of a detector names them."""

    env: str
    split: str = "train"
    detector: str | None = None  # another one than the card's
    first: int | None = None  # so many scenes; None: all
    without: tuple[str, ...] = ()

    def open(self, options: RunOptions) -> Split:
        """Open the scenes, with data root and progress of ``options``."""
        options = replace(
            options, split=self.split, detector=self.detector, scenes=self.first
        )
        return open_split(self.env, options, away=self.without)


@dataclass(frozen=True)
class PresenceRecipe:
    """Recipe of a presence model: the table [presence] of the detector's file."""

    scenes: tuple[SceneChoice, ...]
    features: tuple[str, ...] = tuple(PRESENCE_FEATURES)
    products: bool = True  # of two features
    calibrated: bool = True
    terms: str = ""  # terms of use of the data


def recipe_of(detector: str) -> PresenceRecipe:
    """Return the recipe of a detector.

    Raises UnknownNameError for a detector without one.
    """
    content = read_detector(detector) or {}
    if "presence" not in content:
        names = [n for n in detector_names() if "presence" in (read_detector(n) or {})]
        raise UnknownNameError("detector with a [presence] recipe", detector, names)
    return TypeAdapter(PresenceRecipe).validate_python(content["presence"])


@dataclass(frozen=True, eq=False)
class PresenceRows(TrackHistory):
    """Histories of n tracks in frames, and whether their object was there."""

    class_name: Any  # [n] str
    present: Bools  # [n]
    # [n] str: rows of one scene, or block of a scene, are on one side of a split
    scene: Any


def collect(
    scenes: Iterable[Scene], card: Card, task: Task, in_blocks: bool = False
) -> PresenceRows:
    """Return rows of the single-hypothesis tracker.

    Tracks on neutral objects and in neutral places are left out. ``in_blocks``: rows of
    a scene are held out by blocks of `BLOCK_SECONDS`, not all together. Raises
    MtpBenchError without a track, and for a scene whose truth is not complete: it does
    not tell which tracks follow an object.
    """
    parts = [_scene_rows(scene, card, task, in_blocks) for scene in scenes]
    if not any(len(part.present) for part in parts):
        raise MtpBenchError(
            f"{card.id}: no track in any training scene, so there is nothing to fit"
        )
    return joined(parts)


def _scene_rows(scene: Scene, card: Card, task: Task, in_blocks: bool) -> PresenceRows:
    """Return the rows of a scene, whose tracks are matched as forecasts are."""
    if not scene.truth_complete:
        raise MtpBenchError(
            f"scene {scene.name!r} of {card.id} has the truth of prediction targets "
            "alone, expected that of all objects"
        )
    tracker = HypothesisTracker()
    tracker.reset(task)
    by_frame = [tracker.step(observation) for observation in observations(scene)]
    history = joined(
        [
            history_of(tracks, {"ego_pose": pose}, task.dt)
            for tracks, pose in zip(by_frame, scene.ego, strict=True)
        ]
    )
    counts = [len(tracks.box) for tracks in by_frame]
    frame = np.repeat(np.arange(len(by_frame)), counts)
    track_box = np.concatenate([tracks.box for tracks in by_frame])
    class_id = np.concatenate([tracks.class_id for tracks in by_frame])
    scored = evaluated(scene)
    matching = match_objects(scored.truth, frame, track_box, class_id, card)
    is_neutral = neutral_places(scored, frame, track_box[:, :2], class_id)
    track_row = matching.object_of_truth[~scored.truth.neutral]
    present = np.zeros(len(frame), dtype=bool)
    present[track_row[track_row >= 0]] = True
    block = np.zeros(scene.frames)  # number of each frame's block
    if in_blocks:
        block = (scene.time - scene.time[0]) // BLOCK_SECONDS
    block_names = np.array([f"{scene.name} {number:g}" for number in block])
    rows = PresenceRows(
        **vars(history),
        class_name=np.array(task.classes)[class_id],
        present=present,
        scene=block_names[frame],
    )
    return select(rows, present | (matching.unmatched & ~is_neutral))


def training_rows(
    recipe: PresenceRecipe, options: RunOptions = DEFAULTS
) -> tuple[PresenceRows, list[Origin]]:
    """Return rows of a recipe, and the scenes they are from."""
    parts = []
    origins = []
    for choice in recipe.scenes:
        rows, origin = split_rows(choice.open(options))
        parts.append(rows)
        origins.append(origin)
    return joined(parts), origins


def split_rows(split: Split, in_blocks: bool = False) -> tuple[PresenceRows, Origin]:
    """Return rows of a split, and the scenes they are from.

    ``in_blocks`` as in `collect`.
    """
    card = split.card
    rows = collect(split.scenes(), card, split.task(), in_blocks)
    origin = Origin(
        env=card.id,
        split=card.source.split,
        detector=card.detector_name,
        scenes=list(split.names),
    )
    return rows, origin
