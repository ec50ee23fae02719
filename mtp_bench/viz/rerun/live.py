"""An episode in rerun while it is played: every frame as soon as it is answered."""

import itertools
from dataclasses import replace

import numpy as np
from gymnasium import logger

from ...env.episode import LiveEpisode
from ..replay import Replay
from .entities import Log, log_answers, log_map, log_scene, trail_frames
from .layout import live_layout
from .sdk import rr
from .shown import TOP_HYPOTHESES, ShownAgent

_EPISODES = itertools.count(1)  # of this process: every episode has a place of its own in a recording


class LiveRecording:
    """Renderer of an env: logs into rerun's active recording, that of `rerun.init`.

    The entities of each episode lie under ``episode-1/``, ``episode-2/`` and so on.
    """

    def __init__(self) -> None:
        self._recording = rr.get_data_recording()
        self._episode: LiveEpisode | None = None
        self._root = ""
        if self._recording is None:  # not an error: Gymnasium's checker renders in every mode
            logger.warn("nothing is shown: call rerun.init('mtp_bench', spawn=True) before, which opens a viewer")

    def render(self, episode: LiveEpisode) -> None:
        """Log ``episode.frame``; in evaluation mode nothing that derives from the truth."""
        if self._recording is None:
            return
        scene, t = episode.scene, episode.frame
        run = Replay.of_episode(episode, trail_frames(episode.card.task.rate))
        hypotheses = range(min(TOP_HYPOTHESES, run.answers.hypotheses.member.shape[1]))
        if self._episode is not episode:
            self._episode, self._root = episode, f"episode-{next(_EPISODES)}/"
            # the default: a layout that the user has sent or made stays
            shown = dict.fromkeys(range(TOP_HYPOTHESES), np.nan)  # their weights change
            agent = ShownAgent(run, shown, root=self._root, shared=self._root)
            layout = live_layout(agent)
            self._recording.send_blueprint(layout, make_active=False, make_default=True)
            log_map(self._recording, run, self._root)
        log = Log(self._recording, scene, range(t, t + 1), self._root)
        log_scene(log, run)
        log_answers(replace(log, first=run.first), run, hypotheses, "top")

    def close(self) -> None:
        """Wait until everything has been sent; the viewer stays."""
        if self._recording is not None:
            self._recording.flush()
