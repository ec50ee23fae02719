"""Training rows of the presence model: tracks of training scenes, and whether a true object was there."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..cards import Card
from ..core import Bools, MtpBenchError, Scene, Task, UnknownNameError, joined, select
from ..env import MTPEnv
from ..prediction import FEATURES, TrackHistory, history_of
from ..running import DEFAULTS, RunOptions
from ..scoring import evaluated, match_objects, neutral_places
from ..tracking import HypothesisTracker, detector_names, read_detector
from .split import SceneChoice, Split, observations

MOST_ROWS = (
    40_000  # that a fit takes, every n-th: neighbouring frames are nearly the same
)
FEW_SCENES = 4  # fewer are cut into blocks, so that some rows can be held out
BLOCK_SECONDS = 10.0


@dataclass(frozen=True)
class PresenceRecipe:
    """Recipe to fit the presence model of a detector: the table [presence] of the detector's file."""

    scenes: tuple[SceneChoice, ...]
    features: tuple[str, ...] = tuple(FEATURES)
    products: bool = True  # of two features
    calibrated: bool = True
    terms: str = ""  # of the data

    @classmethod
    def of(cls, detector: str) -> Self:
        """The recipe of a detector; raises UnknownNameError for a detector without one."""
        table: Mapping[str, Any] | None = (read_detector(detector) or {}).get(
            "presence"
        )
        if table is None:
            raise UnknownNameError(
                "detector with a [presence] recipe", detector, fitted_detectors()
            )
        scenes = tuple(
            SceneChoice(**{**row, "without": tuple(row.get("without", ()))})
            for row in table["scenes"]
        )
        return cls(
            **{
                **table,
                "scenes": scenes,
                "features": tuple(table.get("features", FEATURES)),
            }
        )


def fitted_detectors() -> list[str]:
    """Names of the detectors with a recipe."""
    return [
        name for name in detector_names() if "presence" in (read_detector(name) or {})
    ]


@dataclass(frozen=True, eq=False)
class PresenceRows(TrackHistory):
    """Histories of n tracks in frames, and whether their object was there."""

    class_name: Any  # [n] str
    present: Bools  # [n]
    scene: Any  # [n] str: rows of one scene, or block of a scene, are never on both sides of a split


def collect(
    scenes: Iterable[Scene], card: Card, task: Task, in_blocks: bool = False
) -> PresenceRows:
    """Rows of the single-hypothesis tracker; tracks on neutral objects and in neutral places are left out.

    ``in_blocks``: rows of a scene are held out by blocks of `BLOCK_SECONDS`, not all together. Raises MtpBenchError
    without a track, and for a scene whose truth is not complete: which tracks are there is not known.
    """
    parts = [_scene_rows(scene, card, task, in_blocks) for scene in scenes]
    if not any(len(part.present) for part in parts):
        raise MtpBenchError(
            f"{card.id}: no track in any training scene, so there is nothing to fit"
        )
    return joined(parts)


def _scene_rows(scene: Scene, card: Card, task: Task, in_blocks: bool) -> PresenceRows:
    """All tracks of a scene, matched one to one with true objects by the rule for forecasts."""
    if not scene.truth_complete:
        raise MtpBenchError(
            f"scene {scene.name!r} of {card.id} has the truth of prediction targets alone, expected that of all objects"
        )
    tracker = HypothesisTracker()
    tracker.reset(task)
    by_frame = [tracker.step(observation) for observation in observations(scene)]
    poses = [{"ego_pose": pose} for pose in scene.ego]
    history = joined(
        [history_of(*pair, task.dt) for pair in zip(by_frame, poses, strict=True)]
    )
    frame = np.repeat(
        np.arange(len(by_frame)), [len(tracks.box) for tracks in by_frame]
    )
    box, class_id = (
        np.concatenate([getattr(tracks, key) for tracks in by_frame])
        for key in ("box", "class_id")
    )
    shown = evaluated(scene)
    matching = match_objects(shown.truth, frame, box, class_id, card)
    false = matching.unmatched & ~neutral_places(shown, frame, box[:, :2], class_id)
    row = matching.object_of_truth[~shown.truth.neutral]
    present = np.zeros(len(frame), dtype=bool)
    present[row[row >= 0]] = True
    block = (
        (scene.time - scene.time[0]) // BLOCK_SECONDS
        if in_blocks
        else np.zeros(scene.frames)
    )
    block_names = np.array([f"{scene.name} {number:g}" for number in block])
    names = np.array(task.classes)[class_id]
    rows = PresenceRows(
        **vars(history), class_name=names, present=present, scene=block_names[frame]
    )
    return select(rows, present | false)


def training_rows(
    recipe: PresenceRecipe, options: RunOptions = DEFAULTS
) -> tuple[PresenceRows, list[dict[str, Any]]]:
    """The rows of a recipe, and the scenes they are from."""
    parts = []
    origin = []
    for choice in recipe.scenes:
        rows, source = split_rows(choice.open(options))
        parts.append(rows)
        origin.append(source)
    return joined(parts), origin


def split_rows(
    split: Split, in_blocks: bool = False
) -> tuple[PresenceRows, dict[str, Any]]:
    """Return the rows of a split, and the scenes they are from; ``in_blocks`` as in `collect`."""
    card = split.card
    rows = collect(
        split.scenes(), card, MTPEnv(card, data=split.options.data).task, in_blocks
    )
    source = {
        "env": card.id,
        "split": card.source.split,
        "detector": card.detector_name,
    }
    return rows, {**source, "scenes": list(split.names)}
