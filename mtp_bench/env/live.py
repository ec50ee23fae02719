"""The current episode of an env, for renderers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..types import Detections, Ints, Rollout, Scene
from .observation import Feed, LocalFrame
from .rollouts import RecordedAction, assemble, empty_rollout


@dataclass(frozen=True, eq=False)
class LiveEpisode:
    """The current episode; every step appends to ``actions``. In evaluation mode no value derives from the truth."""

    card: Card
    scene: Scene  # its detections are those that the agent is shown; its truth is empty if it must not be seen
    truth_shown: bool
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

    ``feed``: the agent's detections, in the local ``frame``; ``actions``: of the frames so far; ``evaluation``: leave
    out the truth.
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
    return LiveEpisode(card, shown, not evaluation, actions, feed.dropped)
