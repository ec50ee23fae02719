"""An episode as pictures see it while it is played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..types import Detections, Ints, Rollout, Scene
from .decoding import Answer
from .observation import Feed, LocalFrame
from .rollouts import assemble


@dataclass(frozen=True, eq=False)
class LiveEpisode:
    """One per episode; its answers grow. In evaluation mode nothing in it derives from the truth."""

    card: Card
    scene: Scene  # its detections are those that the agent is shown; its truth is empty where it must not be seen
    truth_shown: bool
    answers: Sequence[Answer]  # of the frames until now, in the scene's frame of reference
    dropped: Ints  # [F] detections that did not fit into the observation

    @property
    def frame(self) -> int:
        """The frame that pictures show: the last one that was answered, frame 0 before the first answer."""
        return max(0, len(self.answers) - 1)

    def rollout(self, first: int = 0) -> Rollout | None:
        """What was said from frame ``first`` on, as a rollout that begins there; None where nothing was."""
        said = self.answers[first:]
        return assemble(self.scene.name, said, self.dropped[first : first + len(said)]) if said else None


def live_episode(
    card: Card, scene: Scene, frame: LocalFrame, feed: Feed, answers: Sequence[Answer], evaluation: bool
) -> LiveEpisode:
    """The episode of ``scene`` under the rules of ``card``.

    ``feed`` is what the agent sees of it, in the local ``frame``; ``answers`` is what it said so far, a frame each;
    with ``evaluation`` the truth is not shown.
    """
    seen = Detections(
        start=np.asarray(feed.start),
        box=frame.to_scene(feed.box.astype(np.float64)),
        velocity=np.full((len(feed.box), 2), np.nan),  # the measured one is known in the local frame only
        class_id=feed.class_id,
        score=feed.score,
    )
    shown = replace(scene, detections=seen)
    if evaluation:
        nobody = np.zeros(len(scene.truth.box), dtype=bool)
        shown = replace(shown, truth=scene.truth.select(nobody), visible=None)
    return LiveEpisode(card, shown, not evaluation, answers, feed.dropped)
