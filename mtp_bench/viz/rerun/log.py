"""Runs of a scene as a rerun recording: truth, detections, hypotheses, forecasts, events and counts over all frames.

Positions are logged in the scene's frame of reference, as 32 bit floats: numbers read back are those of the rollout.
A recording is the same for the same runs: no clock, no random name is in it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from ...env.rollouts import digest
from ...errors import MtpBenchError
from ...files import whole_file
from ..replay import Incident, Replay
from .blueprint import layout
from .contents import Contents, contents_of
from .entities import Log, frame_times, log_answers, log_map, log_scene
from .events import log_judgement, log_ring
from .focus import log_camera, log_focus
from .sdk import rr

APPLICATION = "mtp_bench"
ABOUT = """# {scene}
{agents}

Green: truth, and where it goes. Yellow: {given}; {false}. White: the sensor platform.{others}
Tracks have the colour of their id; trails follow a hypothesis along its lineage, forecasts belong to objects and are
the same for all hypotheses. Metres, in the frame of reference of the scene.
"""


def new_recording(contents: Contents) -> rr.RecordingStream:
    """An empty recording named after its content.

    A viewer keeps one layout per application: that of another scene, agent or event would not fit.
    """
    scene, at = contents.agents[0].replay.scene, contents.at
    sha = hashlib.sha256(f"{contents.level}|{scene.name}|{at.name if at else ''}".encode())
    for agent in contents.agents:
        sha.update(f"|{agent.root}|{digest(agent.replay.rollout)}".encode())
    name = sha.hexdigest()[:32]
    recording = rr.RecordingStream(f"{APPLICATION}_{name[:12]}", recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


def save_recording(path: str | Path, replays: Sequence[Replay], level: str = "top", at: Incident | None = None) -> None:
    """Write the recording of runs of one scene (.rrd); ``at``: the views look at this event of the first run.

    ``level``: "off" truth, detections and events; "tracks" also boxes and trails of the heaviest hypotheses; "top" also
    the 3 heaviest forecast samples of each object; "all" every hypothesis and every sample.

    Raises MtpBenchError for runs of several scenes and if the file cannot be written, UnknownNameError for a wrong
    level. An earlier file stays as it was until the new one is complete.
    """
    contents = contents_of(replays, level, at)
    try:
        with whole_file(Path(path)) as part:
            part.touch()  # fails before the work where nothing can be written
            recording = new_recording(contents)
            recording.save(part, default_blueprint=layout(contents))
            log_runs(recording, contents)
    except (OSError, RuntimeError) as error:  # RuntimeError: from rerun, whose texts name the cause
        cause = getattr(error, "strerror", None) or error
        raise MtpBenchError(f"{path}: the recording cannot be written: {cause}") from None


def log_runs(recording: rr.RecordingStream, contents: Contents) -> None:
    """Log the shared content once, then each run under its root, and complete the recording."""
    first = _first(contents)
    log_map(recording, first.scene)
    log_scene(Log(recording, frame_times(first.scene)), first.scene, first.card, first.detection_false)
    recording.log("about", rr.TextDocument(_about(contents), media_type="text/markdown"), static=True)
    for agent in contents.agents:
        log = Log(recording, frame_times(first.scene), agent.root)
        log_answers(log, agent.replay.answers, agent.hypotheses, contents.level, agent.replay.forecast_false)
        log_judgement(log, agent)
    for agent, focus in contents.focuses:
        if agent.number == 0:
            log_ring(recording, first.scene, focus.at, 0.4 + 0.65 * focus.length)
            log_camera(recording, focus)
        log_focus(recording, focus, agent.focus_root, alone=len(contents.agents) == 1)
    recording.flush()
    recording.disconnect()


def _first(contents: Contents) -> Replay:
    """The first run whose agent was given detections, else the first: its input is drawn for all."""
    replays = [agent.replay for agent in contents.agents]
    return next((replay for replay in replays if replay.observe == "detections"), replays[0])


_INSTEAD = {"truth": "true boxes", "tracks": "stored tracks"}  # inputs of agents in place of detections


def _about(contents: Contents) -> str:
    """Meaning of the colours, and agents with another input than the detections."""
    first, agents = _first(contents), contents.agents
    others = [agent.replay for agent in agents if agent.replay.observe in _INSTEAD]
    return ABOUT.format(
        scene=first.scene.name,
        agents=", ".join(f"{agent.replay.agent or 'agent'}: hypotheses {agent.hypotheses}" for agent in agents),
        given=f"{_INSTEAD[first.observe]}, as detections" if first.observe in _INSTEAD else "detections",
        false="false positives red" if first.scene.truth_complete else "which of them are false is not known",
        others="".join(f"\n{r.agent or 'The agent'} was given {_INSTEAD[r.observe]}, not detections." for r in others),
    )
