"""Runs of a scene as a rerun recording: truth, detections, hypotheses, forecasts, events and counts over all frames.

Positions are logged in the scene's frame of reference, as 32 bit floats: numbers read back are those of the rollout.
A recording is the same for the same runs: no clock, no random name is in it.
"""

from __future__ import annotations

import hashlib
import itertools
import re
import secrets
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MtpBenchError, UnknownNameError
from ..rollouts import digest
from ..types import Floats, Ints, Scene
from . import recording_arrays as arrays
from .events_text import incident_text
from .recording_arrays import BoxRows, Strips
from .recording_colors import BORDER, CENTER, EVENTS, MISSED, SERIES, SWITCH, packed, tone, track_colors
from .replay import Incident, Replay
from .rerun_sdk import rr

APPLICATION = "mtp_bench"
LEVELS = ("off", "tracks", "top", "all")
ABOUT = """# {scene}
{agents}

Green: truth, and where it goes. Yellow: detections; red where they are of nothing. White: the sensor platform.
Tracks have the colour of their id; trails follow a hypothesis along its lineage, forecasts belong to objects and are
the same for all hypotheses. Metres, in the frame of reference of the scene.
"""
TRAIL, FUTURE, FORECAST, EDGE = 0.14, 0.09, 0.035, 0.05  # m, half the width of lines
MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box
TRACK_FILL = "transparentfillmajorwireframe"
RING = 3.0  # m, around the event that the views look at


@dataclass(frozen=True, eq=False)
class Shown:
    """One agent in a recording."""

    replay: Replay
    root: str  # prefix of its entities: "" or "agents/<name>/"
    number: int  # of the agents shown
    hypotheses: list[int]


def shown_agents(replays: Sequence[Replay], level: str) -> list[Shown]:
    """The agents of a recording and what is drawn of them; they must be of one scene and have names of their own."""
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    shown: list[Shown] = []
    for replay in replays:
        root = f"agents/{_name(replay.agent, [s.root for s in shown])}/" if len(replays) > 1 else ""
        hypotheses = [] if level == "off" else arrays.shown_hypotheses(replay, level)
        shown.append(Shown(replay, root, len(shown), hypotheses))
    return shown


def _name(agent: str, taken: Iterable[str]) -> str:
    """Part of an entity path; a second run of an agent gets a number."""
    base = re.sub(r"[^\w.-]", "_", agent) or "agent"
    roots = set(taken)
    names = (base if number == 1 else f"{base}-{number}" for number in itertools.count(1))
    return next(name for name in names if f"agents/{name}/" not in roots)


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
    from .rerun_blueprint import layout

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
        _log_judgement(recording, agent)
    if at is not None:
        _log_ring(recording, shown[0].replay, at)


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


def log_map(recording: rr.RecordingStream, scene: Scene, root: str = "") -> None:
    """What does not move."""
    recording.log(f"{root}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for name, color in (("center", CENTER), ("border", BORDER)):
        lines = arrays.map_lines(scene, border=name == "border")
        if lines:
            recording.log(f"{root}world/map/{name}", rr.LineStrips3D(lines, colors=color, radii=EDGE), static=True)


def _log_tracks(recording: rr.RecordingStream, agent: Shown) -> None:
    times = frame_times(agent.replay.scene)
    earlier = arrays.earlier_rows(agent.replay) if agent.hypotheses else np.zeros((0, 0), dtype=np.int64)
    for h in agent.hypotheses:
        root = f"{agent.root}world/hyp/{h:02d}"
        boxes, trails = arrays.hypothesis_boxes(agent.replay, h), arrays.trails(agent.replay, h, earlier)
        log_boxes(recording, f"{root}/box", times, boxes, TRACK_FILL)
        log_strips(recording, f"{root}/trail", times, trails, TRAIL)


def _log_judgement(recording: rr.RecordingStream, agent: Shown) -> None:
    """Events, identity lanes and counts: the judge's view of the best hypothesis."""
    replay = agent.replay
    _log_markers(recording, agent)
    for kind in EVENTS:
        incidents = [i for i in replay.incidents if i.kind == kind]
        if incidents:
            frames = np.array([i.frame for i in incidents])
            texts = [incident_text(i, replay.card.task.classes) for i in incidents]
            colors = np.tile(packed(EVENTS[kind]), len(texts))
            columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
            recording.send_columns(f"{agent.root}events/{_title(kind)}", frame_times(replay.scene, frames), columns)
    for lane in arrays.lanes(replay):
        _log_lane(recording, agent, lane)
    for name, values in arrays.counts(replay).items():
        path = f"{agent.root}metrics/{_title(name)}"
        prefix = f"{agent.root.split('/')[1]} " if agent.root else ""
        style = rr.SeriesLines(colors=packed(tone(SERIES[name], agent.number)), names=prefix + _title(name), widths=2)
        recording.log(path, style, static=True)
        scalars = rr.Scalars.columns(scalars=values.astype(np.float64))
        recording.send_columns(path, frame_times(replay.scene), scalars)


def _title(kind: str) -> str:
    return "IDS" if kind == "ids" else kind


def _log_markers(recording: rr.RecordingStream, agent: Shown) -> None:
    """Where events happened, for some frames after; and forecasts of nothing."""
    times = frame_times(agent.replay.scene)
    now = arrays.visible_incidents(agent.replay)
    incidents = list(itertools.chain.from_iterable(now))
    if incidents:
        columns = rr.Points3D.columns(
            positions=np.array([[i.x, i.y, i.z] for i in incidents]) + MARKER,
            colors=packed(np.array([EVENTS[i.kind] for i in incidents], dtype=np.uint8)),
            labels=[_mark(i) for i in incidents],
        )
        path = f"{agent.root}world/events"
        recording.log(path, rr.Points3D.from_fields(radii=rr.Radius.ui_points(6.0), show_labels=True), static=True)
        recording.send_columns(path, times, columns.partition([len(each) for each in now]))
    count, place = arrays.visible_spurious(agent.replay)
    path, style = f"{agent.root}world/spurious", rr.Points3D.from_fields(radii=0.3, colors=EVENTS["spurious"])
    recording.log(path, style, static=True)
    recording.send_columns(path, times, rr.Points3D.columns(positions=place).partition(count))


def _mark(incident: Incident) -> str:
    if incident.kind == "ids":
        return f"{incident.name}: {incident.old_id} → {incident.new_id}"
    return incident.name


def _log_ring(recording: rr.RecordingStream, replay: Replay, at: Incident) -> None:
    """A ring around the event that the views look at, as long as its mark is there."""
    angle = np.linspace(0.0, 2 * np.pi, 49)
    ring = np.column_stack([at.x + RING * np.cos(angle), at.y + RING * np.sin(angle), np.full(len(angle), at.z)])
    end = at.frame + arrays.EVENT_FRAMES
    frames = np.arange(at.frame, min(end + 1, replay.frames))
    drawn = (frames < end).astype(int)  # the frame after it clears the ring
    lines = np.repeat(ring[None], drawn.sum(), axis=0).astype(np.float32)
    columns = rr.LineStrips3D.columns(strips=lines).partition(drawn)
    recording.log("world/at", rr.LineStrips3D.from_fields(radii=EDGE, colors=SWITCH), static=True)
    recording.send_columns("world/at", frame_times(replay.scene, frames), columns)


def _log_lane(recording: rr.RecordingStream, agent: Shown, lane: arrays.Lane) -> None:
    """One lane: which track follows the object."""
    path = f"{agent.root}identity/gt_{lane.object_id:03d}"
    named = [None if track is None else _state(track) for track in lane.track]
    tracks = sorted({track for track in lane.track if track is not None})
    colors = np.where(np.array(tracks)[:, None] < 0, MISSED, track_colors(np.array(tracks)))
    labels = [_state(i).removeprefix("track ") for i in tracks]
    style = rr.StateConfiguration(values=[_state(i) for i in tracks], labels=labels, colors=packed(colors))
    recording.log(path, style, static=True)
    columns = rr.StateChange.columns(state=["" if name is None else name for name in named])
    recording.send_columns(path, frame_times(agent.replay.scene, np.array(lane.frame)), columns)


def _state(track: int) -> str:
    return "missed" if track < 0 else f"track {track}"


def frame_times(scene: Scene, frames: Ints | None = None) -> list[rr.TimeColumn]:
    """Both timelines at ``frames``, by default all: numbers of frames, and seconds since the first."""
    frames = np.arange(scene.frames) if frames is None else frames
    seconds = (scene.time - scene.time[0])[frames]
    return [
        rr.TimeColumn("frame", sequence=frames),
        rr.TimeColumn("time", duration=np.rint(seconds * 1e9).astype("timedelta64[ns]")),
    ]


def log_ego(recording: rr.RecordingStream, root: str, times: list[rr.TimeColumn], ego: Floats) -> None:
    """The sensor platform at poses [F, 4]; and a frame that moves along with it, without turning, for views."""
    log_boxes(recording, f"{root}world/ego", times, arrays.ego_boxes(ego), "solid")
    place = rr.Transform3D.columns(translation=ego[:, :3].astype(np.float32))
    recording.send_columns(f"{root}world/follow", times, place)


def log_boxes(
    recording: rr.RecordingStream,
    path: str,
    times: list[rr.TimeColumn],
    rows: BoxRows,
    fill: Any,
    radius: float = EDGE,
) -> None:
    """Boxes of the frames of ``times``; a frame without any shows none."""
    style = rr.Boxes3D.from_fields(fill_mode=fill, radii=radius, show_labels=False)
    recording.log(path, style, static=True)
    columns = rr.Boxes3D.columns(
        centers=rows.box[:, :3],
        half_sizes=rows.box[:, 4:7] / 2,
        quaternions=arrays.quaternions(rows.box[:, 3]),
        colors=packed(rows.color),
        labels=rows.label or None,
    )
    recording.send_columns(path, times, columns.partition(rows.count))


def log_strips(
    recording: rr.RecordingStream, path: str, times: list[rr.TimeColumn], lines: Strips, radius: float
) -> None:
    """Polylines of the frames of ``times``; a frame without any shows none."""
    recording.log(path, rr.LineStrips3D.from_fields(radii=radius), static=True)
    columns = rr.LineStrips3D.columns(strips=lines.point, colors=packed(lines.color))
    recording.send_columns(path, times, columns.partition(lines.count))
