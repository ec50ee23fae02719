"""Runs of a scene as a rerun recording: truth, detections, hypotheses, forecasts, events and counts over all frames.

Positions are logged in the scene's frame of reference, as 32 bit floats: numbers read back are those of the rollout.
A recording is the same for the same runs: no clock, no random name is in it.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...env.rollouts import digest
from ...errors import MtpBenchError
from ..replay import Incident, Replay
from . import arrays as arrays
from .agents import Shown, shown_agents
from .blueprint import layout
from .entities import EDGE, FORECAST, FUTURE, TRACK_FILL, TRAIL, frame_times, log_boxes, log_ego, log_map, log_strips
from .events import log_judgement, log_ring
from .sdk import rr

APPLICATION = "mtp_bench"
ABOUT = """# {scene}
{agents}

Green: truth, and where it goes. Yellow: detections; red where they are of nothing. White: the sensor platform.
Tracks have the colour of their id; trails follow a hypothesis along its lineage, forecasts belong to objects and are
the same for all hypotheses. Metres, in the frame of reference of the scene.
"""


def new_recording(shown: Sequence[Shown], level: str, at: Incident | None = None) -> rr.RecordingStream:
    """An empty recording named after its content.

    A viewer keeps one layout per application: that of another scene, agent or event would not fit.
    """
    sha = hashlib.sha256(f"{level}|{shown[0].replay.scene.name}|{at.name if at else ''}".encode())
    for agent in shown:
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

    Raises MtpBenchError where the runs are not of one scene or the file cannot be written, UnknownNameError for a wrong
    level. An earlier file stays as it was until the new one is complete.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    shown = shown_agents(replays, level)
    try:
        partial.touch()  # before there is anything to lose
        recording = new_recording(shown, level, at)
        recording.save(partial, default_blueprint=layout(shown, at))
        log_runs(recording, shown, level, at)
        recording.flush()
        recording.disconnect()
        partial.replace(path)
    except (OSError, RuntimeError) as error:  # RuntimeError: from rerun, whose texts name the cause
        cause = getattr(error, "strerror", None) or error
        raise MtpBenchError(f"{path}: the recording cannot be written: {cause}") from None
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def log_runs(recording: rr.RecordingStream, shown: Sequence[Shown], level: str, at: Incident | None = None) -> None:
    """Log everything: what all runs share once, then each run under its root."""
    _log_scene(recording, shown[0].replay)
    agents = ", ".join(f"{a.replay.agent or 'agent'}: hypotheses {a.hypotheses}" for a in shown)
    about = ABOUT.format(scene=shown[0].replay.scene.name, agents=agents)
    recording.log("about", rr.TextDocument(about, media_type="text/markdown"), static=True)
    for agent in shown:
        _log_tracks(recording, agent)
        if level in ("top", "all"):
            lines = arrays.forecasts(agent.replay, level)
            log_strips(recording, f"{agent.root}world/forecast", frame_times(agent.replay.scene), lines, FORECAST)
        log_judgement(recording, agent)
    if at is not None:
        log_ring(recording, shown[0].replay, at)


def _log_scene(recording: rr.RecordingStream, replay: Replay) -> None:
    """Map, ego, truth and detections: they are the same for every agent."""
    scene, times = replay.scene, frame_times(replay.scene)
    log_map(recording, scene)
    if replay.card.has_ego:
        log_ego(recording, "", times, scene.ego)
    log_boxes(recording, "world/gt", times, arrays.truth_boxes(scene.truth), "majorwireframe", 2 * EDGE)
    log_strips(recording, "world/gt_future", times, arrays.true_futures(scene.truth, replay.card.task.future), FUTURE)
    if len(scene.detections.box):
        detections = arrays.detection_boxes(scene.detections, replay.detection_false)
        log_boxes(recording, "world/det", times, detections, "majorwireframe")


def _log_tracks(recording: rr.RecordingStream, agent: Shown) -> None:
    times = frame_times(agent.replay.scene)
    earlier = arrays.earlier_rows(agent.replay) if agent.hypotheses else np.zeros((0, 0), dtype=np.int64)
    for h in agent.hypotheses:
        root = f"{agent.root}world/hyp/{h:02d}"
        boxes, trails = arrays.hypothesis_boxes(agent.replay, h), arrays.trails(agent.replay, h, earlier)
        log_boxes(recording, f"{root}/box", times, boxes, TRACK_FILL)
        log_strips(recording, f"{root}/trail", times, trails, TRAIL)
