"""The judge's view of a run in a recording: events, identity lanes and counts of the best hypothesis."""

from __future__ import annotations

import itertools

import numpy as np

from ..events_text import incident_text
from ..replay import Incident, Replay
from . import event_rows as arrays
from .agents import Shown
from .colors import EVENTS, MISSED, SERIES, SWITCH, packed, tone, track_colors
from .entities import EDGE, frame_times
from .event_rows import Lane
from .sdk import rr

MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box
RING = 3.0  # m, around the event that the views look at


def log_judgement(recording: rr.RecordingStream, agent: Shown) -> None:
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


def log_ring(recording: rr.RecordingStream, replay: Replay, at: Incident) -> None:
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


def _log_lane(recording: rr.RecordingStream, agent: Shown, lane: Lane) -> None:
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
