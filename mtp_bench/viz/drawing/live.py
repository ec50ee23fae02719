"""Showing an episode while it is played: one renderer per render mode of the env."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...env.live import LiveEpisode
from ...errors import UnknownNameError
from ...scoring.lineage import hypotheses
from ..frame_view import TRAIL_SECONDS, FrameView, said
from .birds_eye import draw_frame
from .camera import Camera, camera


class Renderer(Protocol):
    """What the env calls; it is kept over the episodes of an env."""

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8] | None:
        """Show ``episode.frame``; a picture [height, width, 3], or None where it is shown elsewhere."""
        ...

    def close(self) -> None:
        """Let go of whatever is open."""
        ...


def open_renderer(mode: str) -> Renderer:
    """The renderer of a render mode of the env; raises UnknownNameError for one that it has not."""
    if mode == "rgb_array":
        return Pictures()
    if mode == "rerun":
        from ..rerun.live import LiveRecording

        return LiveRecording()
    raise UnknownNameError("render mode", mode, ("rgb_array", "rerun"))


class Pictures:
    """Bird's-eye pictures of the frame that was answered last, with its answer; before the first, of frame 0."""

    def __init__(self) -> None:
        self._episode: LiveEpisode | None = None
        self._camera: Camera | None = None

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8]:
        """A picture [height, width, 3], always of the same size."""
        if self._camera is None or self._episode is not episode:
            seen = episode.scene.detections
            frame = seen.frame_of_rows
            self._camera = camera(episode.card.has_ego, episode.scene.ego, seen.box[:, :2], frame)
            self._episode = episode
        return draw_frame(live_view(episode, self._camera))

    def close(self) -> None:
        """Nothing is open."""


def live_view(episode: LiveEpisode, seen_by: Camera) -> FrameView:
    """The frame of the last answer; true boxes are not compared with it, the judge does that afterwards."""
    scene, card, t = episode.scene, episode.card, episode.frame
    rollout = episode.rollout(max(0, t - round(TRAIL_SECONDS * card.task.rate)))
    truth = scene.truth.rows(t)
    return FrameView(
        env_id=card.id,
        agent="",
        scene=scene.name,
        frame=t,
        frames=scene.frames,
        seconds=float(scene.time[t] - scene.time[0]),
        viewport=seen_by.at(scene.ego[t]),
        lanes=scene.lanes,
        ego=scene.ego[t] if card.has_ego else None,
        truth_box=scene.truth.box[truth][~scene.truth.neutral[truth]] if episode.truth_shown else None,
        detection_box=scene.detections.box[scene.detections.rows(t)],
        said=None if rollout is None else said(rollout, hypotheses(rollout, card), rollout.frames - 1, card),
        judged=None,
    )
