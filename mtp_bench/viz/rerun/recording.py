"""Runs of a scene as a rerun recording: truth, detections, hypotheses, forecasts, events and counts over all frames.

Positions are logged in the scene's frame of reference, as 32 bit floats: numbers read back are those of the rollout.
A recording is the same for the same runs: no clock, no random name is in it.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...env.rollouts import digest
from ...errors import MtpBenchError
from ...files import whole_file
from ..framing import frames_around
from ..incident import Incident
from ..pages import text_of
from ..replay import Replay
from .entities import EVENT, Log, log_answers, log_map, log_scene
from .events import log_judgement
from .focus import event_key, log_focus
from .layout import layout
from .sdk import rr
from .shown import ShownAgent, drawable, shown_agents

APPLICATION = "mtp_bench"
_HERE = Path(__file__).parent


def save_recording(path: str | Path, replays: Sequence[Replay], level: str = "top", at: Incident | None = None) -> None:
    """Write the recording of runs of one scene (.rrd); ``at``: the views look at this event of the first run.

    ``level``: "tracks" truth, detections, events, and boxes and trails of the heaviest hypotheses; "top" also the 3
    heaviest forecast samples of each object; "all" every hypothesis and every sample.

    Raises MtpBenchError for runs of several scenes and if the file cannot be written, UnknownNameError for a wrong
    level. An earlier file stays as it was until the new one is complete.
    """
    agents = shown_agents(replays, level, at)
    try:
        with whole_file(Path(path)) as part:
            part.touch()  # fails before the work where nothing can be written
            recording = _new_recording(agents, level, at)
            recording.save(part, default_blueprint=layout(agents, at))
            _log_runs(recording, agents, level, at)
            recording.flush()
            recording.disconnect()
    except (OSError, RuntimeError) as error:  # RuntimeError: from rerun, whose texts name the cause
        cause = getattr(error, "strerror", None) or error
        raise MtpBenchError(f"{path}: the recording cannot be written: {cause}") from None


def _new_recording(agents: Sequence[ShownAgent], level: str, at: Incident | None) -> rr.RecordingStream:
    """An empty recording named after its content.

    A viewer keeps one layout per application: that of another scene, agent or event would not fit.
    """
    sha = hashlib.sha256(f"{level}|{agents[0].replay.scene.name}|{at.name if at else ''}".encode())
    for agent in agents:
        sha.update(f"|{agent.root}|{digest(agent.replay.rollout)}".encode())
    name = sha.hexdigest()[:32]
    recording = rr.RecordingStream(f"{APPLICATION}_{name[:12]}", recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


def _log_runs(recording: rr.RecordingStream, agents: Sequence[ShownAgent], level: str, at: Incident | None) -> None:
    """Log the content that all runs share once, then each run under its root."""
    scene, runs = agents[0].replay.scene, [agent.replay for agent in agents]
    focuses = [agent.focus for agent in agents if agent.focus is not None]
    log_map(recording, runs[0])
    logs = [Log(recording, scene, range(scene.frames))]
    if at is not None:  # a viewer begins at the first time of a timeline: a layout has no field for another one
        logs.append(Log(recording, scene, frames_around(scene, at.frame), seconds=(EVENT,)))
    for log in logs:
        log_scene(log, runs[0])
        for agent in agents:
            own = replace(log, root=agent.root)
            log_answers(own, agent.replay, agent.hypotheses, level)
            log_judgement(own, agent)
    for number in range(len(focuses)):
        log_focus(recording, focuses, number, agents[number].root, logs[1].frames)
    key = text_of(_HERE, "scene_key.md").format(agents=", ".join(run.agent for run in runs), scene=scene.name)
    key = drawable(event_key(focuses[0]) if focuses else key)
    recording.log("key", rr.TextDocument(key, media_type="text/markdown"), static=True)
