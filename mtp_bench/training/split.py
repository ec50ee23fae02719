"""Scenes that parameters are fitted to: of the training split of an env, or another one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..core import MtpBenchError, Observation, Scene
from ..env import true_detections
from ..running import Fold, RunOptions, held_out
from ..sources import SceneSource, open_source


@dataclass(frozen=True)
class Split:
    """Scenes of one split of an env."""

    card: Card  # with the changes of the options
    source: SceneSource
    names: tuple[str, ...]
    options: RunOptions

    def scenes(self) -> Iterator[Scene]:
        """The scenes, one after the other; each counts as done when the next one is asked for."""
        self.options.progress.started(len(self.names))
        for name in self.names:
            yield self.source.load(name)
            self.options.progress.done(name)


def open_split(
    env_id: str,
    options: RunOptions,
    without: Fold | None = None,
    away: Sequence[str] = (),
) -> Split:
    """The first scenes of the split that ``options`` names; raises MtpBenchError for a split without scenes.

    ``without``: a fold of the whole split, for another run scores it; ``away``: further scenes to leave out. The first
    of the others are taken. Those of a closed loop have no agent: the ego is one of the traffic's own drivers.
    """
    card = options.card(env_id).model_copy(update={"drive": None})
    source = open_source(card, options.data)
    fold = () if without is None else held_out(source.names, without)
    names = options.chosen(
        [name for name in source.names if name not in fold and name not in away]
    )
    if not names:
        raise MtpBenchError(f"{env_id} has no scene in its split {card.source.split!r}")
    return Split(card, source, names, options)


def observations(scene: Scene, observe: str = "detections") -> Iterator[Observation]:
    """Observations of a scene as far as trackers read them, unpadded and in the scene's own frame."""
    shown, ids = (
        true_detections(scene) if observe == "truth" else (scene.detections, None)
    )
    for t in range(scene.frames):
        rows = shown.rows(t)
        seen: Observation = {
            "detection_box": shown.box[rows],
            "detection_class": shown.class_id[rows],
            "detection_score": shown.score[rows],
            "detection_velocity": np.nan_to_num(shown.velocity[rows]),
            "detection_valid": np.ones(len(shown.box[rows]), dtype=bool),
            "dt": np.asarray(scene.time[t] - scene.time[max(t - 1, 0)]),
        }
        yield seen if ids is None else {**seen, "detection_id": ids[rows]}


@dataclass(frozen=True)
class SceneChoice:
    """Scenes of an env, as the file of a detector names them for its fits."""

    env: str
    split: str = "train"
    detector: str | None = None  # another one than the card's
    first: int | None = None  # so many scenes; None: all
    without: tuple[str, ...] = ()

    def options(self, options: RunOptions) -> RunOptions:
        """``options`` on these scenes."""
        return replace(
            options, split=self.split, detector=self.detector, scenes=self.first
        )

    def open(self, options: RunOptions) -> Split:
        """The scenes themselves."""
        return open_split(self.env, self.options(options), away=self.without)
