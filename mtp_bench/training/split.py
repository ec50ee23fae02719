"""Scenes that parameters are fitted to: of the training split of an env, or another."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..core import MtpBenchError, Observation, Scene, Task, say_once
from ..env import MTPEnv, true_detections
from ..running import Fold, RunOptions, held_out, other_split, scenes_of_card
from ..sources import SceneSource, open_source

_MOST_NAMED = 10  # scenes in a line


@dataclass(frozen=True)
class Split:
    """Scenes of one split of an env."""

    card: Card  # with the changes of the options
    source: SceneSource
    names: tuple[str, ...]
    options: RunOptions

    def scenes(self) -> Iterator[Scene]:
        """Load the scenes, one after the other.

        Each counts as done when the next one is asked for.
        """
        self.options.progress.started(len(self.names))
        for name in self.names:
            yield self.source.load(name)
            self.options.progress.done(name)

    def task(self, observe: str = "detections") -> Task:
        """Return the task of the env, observing detections or the truth."""
        return MTPEnv(self.card, data=self.options.data, observe=observe).task


def open_split(
    env_id: str | Card,
    options: RunOptions,
    without: Fold | None = None,
    away: Sequence[str] = (),
) -> Split:
    """Return the first scenes of the split that ``options`` names.

    ``without``: a fold of the whole split, for another run scores it; ``away``: further
    scenes to leave out. The first of the remaining scenes are taken, as many as
    ``options`` says. Scenes of a closed loop are played without an agent: the ego is
    one of the traffic's own drivers. Raises MtpBenchError for
    a split without scenes.
    """
    card = options.card(env_id).model_copy(update={"drive": None})
    source = open_source(card, options.data)
    left_out = set(away)
    if without is not None:
        left_out.update(held_out(source.names, without))
    scene_names = options.chosen(
        [scene_name for scene_name in source.names if scene_name not in left_out]
    )
    if not scene_names:
        raise MtpBenchError(
            f"{card.id} has no scene in its split {card.source.split!r}"
        )
    if not left_out:
        _say_scored(scene_names, replace(options, split=None).card(env_id), options)
    return Split(card, source, scene_names, options)


def _say_scored(names: Sequence[str], card: Card, options: RunOptions) -> None:
    """Name the scenes that the env scores by default."""
    scored = scenes_of_card(names, card, options.data)
    if scored:
        text = (
            f"{len(scored)} of these {len(names)} scenes are scored by {card.id}: "
            f"{', '.join(scored[:_MOST_NAMED])}"
        )
        split = other_split(names, card, options.data)
        if split is not None:
            text += f"; score others with --split {split} (split={split!r})"
        say_once(text)


def observations(scene: Scene, observe: str = "detections") -> Iterator[Observation]:
    """Yield the observation of each frame, with the fields that trackers read.

    Arrays are unpadded, and in the scene's own frame of reference. ``observe``:
    "detections" or "truth".
    """
    boxes = scene.detections
    object_ids = None
    if observe == "truth":
        boxes, object_ids = true_detections(scene)
    for t in range(scene.frames):
        rows = boxes.rows(t)
        observation: Observation = {
            "detection_box": boxes.box[rows],
            "detection_class": boxes.class_id[rows],
            "detection_score": boxes.score[rows],
            "detection_velocity": np.nan_to_num(boxes.velocity[rows]),
            "detection_valid": np.ones(rows.stop - rows.start, dtype=bool),
            "dt": np.asarray(scene.time[t] - scene.time[max(t - 1, 0)]),
        }
        if object_ids is not None:
            observation["detection_id"] = object_ids[rows]
        yield observation
