"""Bird's-eye pictures of an episode while it is played."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...env.live import LiveEpisode
from ..answers import Answers
from ..frame_view import TRAIL_SECONDS, FrameView, said_at
from .birds_eye import draw_frame
from .camera import Camera, camera


class Pictures:
    """Bird's-eye pictures of the frame that was answered last, with its answer; before the first, of frame 0."""

    def __init__(self) -> None:
        self._seen_by: tuple[LiveEpisode, Camera] | None = None

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8]:
        """A picture [height, width, 3], always of the same size."""
        if self._seen_by is None or self._seen_by[0] is not episode:
            self._seen_by = episode, camera(episode.scene, episode.card)
        return draw_frame(live_view(episode), self._seen_by[1])

    def close(self) -> None:
        """Nothing is open."""


def live_view(episode: LiveEpisode) -> FrameView:
    """The frame of the last answer; true boxes are not compared with it, the judge does that afterwards."""
    scene, card, t = episode.scene, episode.card, episode.frame
    rollout = episode.rollout(max(0, t - round(TRAIL_SECONDS * card.task.rate)))
    said = None if rollout is None else said_at(Answers(rollout, card), rollout.frames - 1)
    return FrameView(scene, card, t, said, truth_shown=episode.truth_shown)
