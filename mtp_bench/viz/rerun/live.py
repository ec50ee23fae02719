"""An episode in rerun while it is played: every frame as soon as it is answered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import logger

from ...cards import Card
from ...env.live import LiveEpisode
from ...errors import MtpBenchError
from ...scoring.lineage import hypotheses
from ...types import Bools, Ints, Rollout
from ..replay import object_tracks
from . import arrays as arrays
from . import entities as entities
from .arrays import frame_of, strips_of
from .blueprint import live_layout
from .entities import EDGE, frame_times, log_boxes, log_strips
from .log import APPLICATION
from .sdk import rr
from .viewer import open_viewer


class LiveRecording:
    """Logs into rerun's active recording where there is one (`rerun.init`), else into a viewer that it opens.

    In the user's own recording the second and later episodes lie under ``episode-2/`` and so on; a viewer of our own
    gets a recording per episode.
    """

    def __init__(self) -> None:
        self._user = rr.get_data_recording()
        self._address: str | None = None
        self._episode: LiveEpisode | None = None
        self._count = 0
        self._root = ""
        self._recording = self._user
        if self._user is None:
            try:
                self._address = open_viewer("call rerun.init() and rerun.save() or rerun.connect_grpc() before")
            except MtpBenchError as error:
                # Not an error: Gymnasium's checker renders in every mode, also where there is no screen.
                logger.warn(f"nothing is shown: {error}")

    def render(self, episode: LiveEpisode) -> None:
        """Log ``episode.frame``; in evaluation mode nothing that derives from the truth."""
        if self._user is None and self._address is None:
            return
        if self._episode is not episode:
            self._begin(episode)
        assert self._recording is not None
        log_frame(self._recording, episode, self._root)

    def close(self) -> None:
        """Wait until everything has been sent; the viewer stays."""
        if self._recording is not None:
            self._recording.flush()

    def _begin(self, episode: LiveEpisode) -> None:
        self._episode = episode
        self._count += 1
        if self._address is not None:
            self.close()
            name = f"{episode.scene.name} ({self._count})"
            self._recording = rr.RecordingStream(APPLICATION, recording_id=None, send_properties=False)
            self._recording.connect_grpc(self._address)
            self._recording.send_recording_name(name)
            self._recording.send_blueprint(live_layout(episode.scene, episode.card))
        elif self._count > 1:
            self._root = f"episode-{self._count}/"
        assert self._recording is not None
        entities.log_map(self._recording, episode.scene, self._root)


@dataclass(frozen=True, eq=False)
class _Window:
    """The last frames of an episode, as long as trails are."""

    rollout: Rollout
    card: Card
    member: Bools
    parent: Ints
    object_track: Ints


def log_frame(recording: rr.RecordingStream, episode: LiveEpisode, root: str = "") -> None:
    """Log the frame that was answered last, with its answer; frame 0 before the first answer."""
    scene, card, t = episode.scene, episode.card, episode.frame
    times = frame_times(scene, np.array([t]))
    if card.has_ego:
        entities.log_ego(recording, root, times, scene.ego[t : t + 1])
    detections = arrays.detection_boxes(scene.detections, np.zeros(len(scene.detections.box), dtype=bool))
    log_boxes(recording, f"{root}world/det", times, frame_of(detections, t), "majorwireframe")
    if episode.truth_shown:
        truth = arrays.truth_boxes(scene.truth)
        log_boxes(recording, f"{root}world/gt", times, frame_of(truth, t), "majorwireframe", 2 * EDGE)
        futures = arrays.true_futures(scene.truth, card.task.future)
        log_strips(recording, f"{root}world/gt_future", times, strips_of(futures, t), entities.FUTURE)
    first = max(0, t - arrays.trail_frames(card.task.rate))
    said = episode.rollout(first)
    if said is not None:
        _log_answer(recording, _window(said, card), times, root)


def _window(said: Rollout, card: Card) -> _Window:
    found = hypotheses(said, card)
    frame = said.tracks.frame_of_rows
    shown = found.member[np.arange(len(frame)), found.best[frame]]
    return _Window(said, card, found.member, found.parent, object_tracks(said, card, shown))


def _log_answer(recording: rr.RecordingStream, said: _Window, times: list[rr.TimeColumn], root: str) -> None:
    """The last frame of a window, in the hypotheses that come first."""
    last = said.rollout.frames - 1
    earlier = arrays.earlier_rows(said)
    for h in range(min(arrays.TOP_HYPOTHESES, said.member.shape[1])):
        path = f"{root}world/hyp/{h:02d}"
        boxes, trails = arrays.hypothesis_boxes(said, h), arrays.trails(said, h, earlier)
        log_boxes(recording, f"{path}/box", times, frame_of(boxes, last), entities.TRACK_FILL)
        log_strips(recording, f"{path}/trail", times, strips_of(trails, last), entities.TRAIL)
    forecasts = strips_of(arrays.forecasts(said, "top"), last)
    log_strips(recording, f"{root}world/forecast", times, forecasts, entities.FORECAST)
