"""An episode in rerun while it is played: every frame as soon as it is answered."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from gymnasium import logger

from ...env.live import LiveEpisode
from ...errors import MtpBenchError
from ..answers import Answers
from .blueprint import live_layout
from .contents import TOP_HYPOTHESES
from .entities import Log, frame_times, log_answers, log_map, log_scene, trail_frames
from .log import APPLICATION
from .sdk import rr
from .viewer import open_viewer


class LiveRecording:
    """Renderer of an env: logs into rerun's active recording (`rerun.init`), else into a viewer that it opens.

    In the user's own recording the second and later episodes, of any env, lie under ``episode-2/`` and so on; a viewer
    of our own gets a recording per episode.
    """

    _episodes: ClassVar[dict[str, int]] = {}  # that each of the user's own recordings has, by its id

    def __init__(self) -> None:
        self._recording = rr.get_data_recording()
        self._address: str | None = None  # of a viewer of our own
        self._episode: LiveEpisode | None = None
        self._count = 0  # of the viewer of our own
        self._root = ""
        if self._recording is None:
            try:
                self._address = open_viewer("call rerun.init() and rerun.save() or rerun.connect_grpc() before")
            except MtpBenchError as error:
                # Not an error: Gymnasium's checker renders in every mode, also where there is no screen.
                logger.warn(f"nothing is shown: {error}")

    def render(self, episode: LiveEpisode) -> None:
        """Log ``episode.frame``; in evaluation mode nothing that derives from the truth."""
        if self._episode is not episode:
            self._begin(episode)
        if self._recording is not None:
            log_frame(self._recording, episode, self._root)

    def close(self) -> None:
        """Wait until everything has been sent; the viewer stays."""
        if self._recording is not None:
            self._recording.flush()

    def _begin(self, episode: LiveEpisode) -> None:
        self._episode = episode
        if self._address is not None:
            self.close()
            self._count += 1
            self._recording = rr.RecordingStream(APPLICATION, recording_id=None, send_properties=False)
            self._recording.connect_grpc(self._address)
            self._recording.send_recording_name(f"{episode.scene.name} ({self._count})")
            self._recording.send_blueprint(live_layout(episode.scene, episode.card))
        elif self._recording is not None:
            recording = str(self._recording.get_recording_id())
            number = self._episodes[recording] = self._episodes.get(recording, 0) + 1
            self._root = f"episode-{number}/" if number > 1 else ""
            # the default: a layout that the user has sent or made stays
            layout = live_layout(episode.scene, episode.card, self._root)
            self._recording.send_blueprint(layout, make_active=False, make_default=True)
        if self._recording is not None:
            log_map(self._recording, episode.scene, self._root)


def log_frame(recording: rr.RecordingStream, episode: LiveEpisode, root: str = "") -> None:
    """Log the frame that was answered last, with its answer; frame 0 before the first answer."""
    scene, card, t = episode.scene, episode.card, episode.frame
    log = Log(recording, frame_times(scene, np.array([t])), root, only=t)
    log_scene(log, scene, card, truth_shown=episode.truth_shown)
    rollout = episode.rollout(max(0, t - trail_frames(card.task.rate)))
    if rollout is not None:
        answers = Answers(rollout, card)
        first = range(min(TOP_HYPOTHESES, answers.hypotheses.member.shape[1]))
        log_answers(replace(log, only=rollout.frames - 1), answers, first, "top")
