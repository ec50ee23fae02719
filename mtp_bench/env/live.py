"""The current episode of an env, and the renderers that draw it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..types import Detections, Ints, Rollout, Scene
from .observation import Feed, LocalFrame
from .rollouts import RecordedAction, assemble, empty_rollout

RENDERERS = {  # render mode -> class, imported when an env first renders
    "rgb_array": "mtp_bench.viz.drawing.birds_eye:EpisodePictures",
    "rerun": "mtp_bench.viz.rerun.live:LiveRecording",
}


@dataclass(frozen=True, eq=False)
class LiveEpisode:
    """The current episode; every step appends to ``actions``. In evaluation mode no value derives from the truth."""

    card: Card
    scene: Scene  # its detections are those that the agent is shown; its truth is empty if it must not be seen
    actions: Sequence[RecordedAction]  # of the frames until now, in the scene's frame of reference
    dropped: Ints  # [F] detections that did not fit into the observation

    @property
    def frame(self) -> int:
        """The frame of the last action; 0 before the first one."""
        return max(0, len(self.actions) - 1)

    def rollout(self, first: int = 0) -> Rollout:
        """Actions from frame ``first`` on, as a rollout that begins there; a frame without rows before any action."""
        actions = self.actions[first:]
        if not actions:
            return empty_rollout(self.scene.name)
        return assemble(self.scene.name, actions, self.dropped[first : first + len(actions)])


def live_episode(
    card: Card, scene: Scene, frame: LocalFrame, feed: Feed, actions: Sequence[RecordedAction], evaluation: bool
) -> LiveEpisode:
    """The current episode of ``scene`` under the rules of ``card``.

    ``feed``: the agent's detections, in the local ``frame``; ``actions``: so far; ``evaluation``: leave out the truth.
    """
    seen = Detections(
        start=np.asarray(feed.start),
        box=frame.to_scene(feed.box.astype(np.float64)),
        velocity=np.full((len(feed.box), 2), np.nan),  # the measured one is in the local frame
        class_id=feed.class_id,
        score=feed.score,
    )
    shown = replace(scene, detections=seen)
    if evaluation:
        hidden = np.zeros(len(scene.truth.box), dtype=bool)
        shown = replace(shown, truth=scene.truth.select(hidden), visible=None)
    return LiveEpisode(card, shown, actions, feed.dropped)


class Renderer(Protocol):
    """Drawing of an episode while it is played; one object serves all episodes of an env."""

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8] | None:
        """Draw the frame that was answered last; returns the picture [height, width, 3], if there is one."""

    def close(self) -> None:
        """Release what drawing has opened."""
