"""Runs of a scene as a rerun recording, and an episode while it is played.

Positions are logged in the scene's frame of reference, as 32 bit floats: numbers read
back are those of the rollout. A recording is the same for the same runs: no clock, no
random name is in it.
"""

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from gymnasium import logger

from ...core import MtpBenchError, whole_file
from ...env import LiveEpisode, digest
from ..evidence import gate
from ..framing import frames_around
from ..incident import Incident
from ..pages import text_of
from ..run_replay import Replay
from .entities import EVENT, Log, log_answers, log_map, log_scene, trail_frames
from .events import log_focus, log_judgement
from .layout import layout, live_layout
from .sdk import rr
from .shown import TOP_HYPOTHESES, ShownAgent, drawable, shown_agents

APPLICATION = "mtp_bench"
_FOLDER = Path(__file__).parent
# of this process: every episode has a place of its own in a recording
_EPISODES = itertools.count(1)


def save_recording(
    path: str | Path,
    replays: Sequence[Replay],
    is_all: bool = False,
    at: Incident | None = None,
) -> None:
    """Write the recording of runs of one scene (.rrd).

    ``at``: the views look at this event of the first run. ``is_all``: every
    hypothesis and sample, else the heaviest.

    Raises MtpBenchError for runs of several scenes and if the file cannot be written.
    An earlier file stays as it was until the new
    one is complete.
    """
    agents = shown_agents(replays, is_all, at)
    try:
        with whole_file(Path(path)) as part:
            part.touch()  # fails before the work where nothing can be written
            recording = _new_recording(agents, is_all, at)
            recording.save(part, default_blueprint=layout(agents, at))
            _log_runs(recording, agents, is_all, at)
            recording.flush()
            recording.disconnect()
    # RuntimeError: from rerun, whose texts name the cause
    except (OSError, RuntimeError) as error:
        cause = getattr(error, "strerror", None) or error
        raise MtpBenchError(
            f"{path}: the recording cannot be written: {cause}"
        ) from None


def _new_recording(
    agents: Sequence[ShownAgent], is_all: bool, at: Incident | None
) -> rr.RecordingStream:
    """Return an empty recording named after its content.

    A viewer keeps one layout per application: that of another scene, agent or event
    would not fit.
    """
    event_name = at.name if at else ""
    text = f"{is_all}|{agents[0].replay.scene.name}|{event_name}"
    for agent in agents:
        text += f"|{agent.root}|{digest(agent.replay.rollout)}"
    name = hashlib.sha256(text.encode()).hexdigest()[:32]
    recording = rr.RecordingStream(
        f"{APPLICATION}_{name[:12]}", recording_id=name, send_properties=False
    )
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


def _log_runs(
    recording: rr.RecordingStream,
    agents: Sequence[ShownAgent],
    is_all: bool,
    at: Incident | None,
) -> None:
    """Log shared content once, then each run under its root."""
    scene = agents[0].replay.scene
    focuses = [agent.focus for agent in agents if agent.focus is not None]
    log_map(recording, agents[0].replay)
    logs = [Log(recording, scene, range(scene.frames))]
    # a viewer begins at the first time of a timeline, which no layout can change: that
    # of the event has no earlier frames
    if at is not None:
        frames = frames_around(scene, at.frame)
        logs.append(Log(recording, scene, frames, timeline=EVENT))
    for log in logs:
        log_scene(log, agents[0].replay)
        for agent in agents:
            agent_log = replace(log, root=agent.root)
            log_answers(agent_log, agent.replay, agent.hypotheses, is_all)
            log_judgement(agent_log, agent)
    for agent in agents:
        if agent.focus is not None:
            log_focus(replace(logs[0], root=agent.root), focuses, agent.focus)
    key = text_of(_FOLDER, "key.md").format(
        agents=", ".join(agent.replay.agent for agent in agents),
        scene=scene.name,
        gate=f" ({gate(focuses[0]).text})" if focuses else "",
    )
    text = rr.TextDocument(drawable(key), media_type="text/markdown")
    recording.log("key", text, static=True)


class LiveRecording:
    """Renderer of an env: logs into rerun's active recording, that of `rerun.init`.

    The entities of each episode lie under ``episode-1/``, ``episode-2/`` and so on.
    """

    def __init__(self) -> None:
        self._recording = rr.get_data_recording()
        self._episode: LiveEpisode | None = None
        self._root = ""
        # not an error: Gymnasium's checker renders in every mode
        if self._recording is None:
            logger.warn(
                "nothing is shown: call rerun.init('mtp_bench', spawn=True) before, "
                "which opens a viewer"
            )

    def render(self, episode: LiveEpisode) -> None:
        """Log ``episode.frame``.

        In evaluation mode nothing derives from the truth.
        """
        if self._recording is None:
            return
        t = episode.frame
        replay = Replay.of_episode(episode, trail_frames(episode.card.task.rate))
        # a new episode has a new list of actions
        if self._episode is None or self._episode.actions is not episode.actions:
            self._episode = episode
            self._root = f"episode-{next(_EPISODES)}/"
            # NaN is not shown: weights change while a title does not
            weights = dict.fromkeys(range(TOP_HYPOTHESES), np.nan)
            agent = ShownAgent(
                replay, weights, root=self._root, shared_prefix=self._root
            )
            # as the default: a layout that the user has sent or made stays
            self._recording.send_blueprint(
                live_layout(agent), make_active=False, make_default=True
            )
            log_map(self._recording, replay, self._root)
        log = Log(self._recording, episode.scene, range(t, t + 1), self._root)
        log_scene(log, replay)
        count = replay.answers.hypotheses.member.shape[1]
        hypotheses = range(min(TOP_HYPOTHESES, count))
        log_answers(replace(log, first=replay.first), replay, hypotheses, is_all=False)

    def close(self) -> None:
        """Wait until everything has been sent."""
        if self._recording is not None:
            self._recording.flush()
