"""Judgement of a run in a recording: events, identity lanes and counts of the best hypothesis."""

from __future__ import annotations

import itertools

import numpy as np

from ...types import Ints, Scene
from ..case import Case
from ..replay import KINDS, Incident, Replay
from ..sentence import sentence
from .colors import EVENTS, SERIES, SWITCH, UNTRACKED, packed, tone, track_colors
from .contents import ShownAgent, box_counts
from .entities import EDGE, Log, frame_times
from .sdk import rr

EVENT_FRAMES = 10  # frames that an event stays in the picture
MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box


def log_judgement(log: Log, agent: ShownAgent) -> None:
    """Log events, identity lanes and counts of the best hypothesis."""
    _log_markers(log, agent.replay)
    _log_texts(log, agent.replay)
    for object_id, lane in lanes(agent.replay).items():
        _log_lane(log, agent.replay.scene, object_id, lane)
    for name, values in _series(agent.replay).items():
        names = f"{agent.name} {name}".strip()
        color = packed(tone(SERIES["ids" if name == "IDS" else name], agent.number))
        scalars = rr.Scalars.columns(scalars=values.astype(np.float64))
        log.columns(f"metrics/{name}", rr.SeriesLines(colors=color, names=names, widths=2), scalars)


def _title(kind: str) -> str:
    return {"ids": "IDS", "spurious": "false_forecast"}.get(kind, kind)


def _series(replay: Replay) -> dict[str, Ints]:
    """Numbers of boxes in each frame [F], and of events until then."""
    happened = {
        kind: np.bincount([i.frame for i in replay.events if i.kind == kind], minlength=replay.frames)
        for kind in KINDS[:-1]
    }
    return box_counts(replay) | {_title(kind): np.cumsum(count) for kind, count in happened.items()}


def _log_texts(log: Log, replay: Replay) -> None:
    """Log the sentences of the events."""
    for kind in KINDS:
        incidents = [i for i in replay.incidents if i.kind == kind]
        if incidents:
            texts = [sentence(Case(replay, incident)) for incident in incidents]
            colors = np.tile(packed(EVENTS[kind]), len(texts))
            columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
            times = frame_times(replay.scene, np.array([i.frame for i in incidents]))
            log.recording.send_columns(f"{log.root}events/{_title(kind)}", times, columns)


def _log_markers(log: Log, replay: Replay) -> None:
    """Log the places of events, for some frames after; and false forecasts."""
    now = [replay.recent(t, EVENT_FRAMES) for t in range(replay.frames)]
    incidents = list(itertools.chain.from_iterable(now))
    if incidents:
        columns = rr.Points3D.columns(
            positions=np.array([i.position for i in incidents]) + MARKER,
            colors=packed(np.array([EVENTS[i.kind] for i in incidents], dtype=np.uint8)),
            labels=[f"{i.name}: {i.old_id} → {i.new_id}" if i.kind == "ids" else i.name for i in incidents],
        )
        style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(6.0), show_labels=True)
        log.columns("world/events", style, columns.partition([len(each) for each in now]))
    rows = np.flatnonzero(replay.forecast_false)
    places = rr.Points3D.columns(positions=replay.rollout.object_box[rows, :3].astype(np.float32))
    count = np.diff(np.searchsorted(rows, replay.rollout.object_start))
    style = rr.Points3D.from_fields(radii=0.3, colors=EVENTS["spurious"])
    log.columns("world/false_forecast/place", style, places.partition(count))


def log_ring(recording: rr.RecordingStream, scene: Scene, at: Incident, radius: float) -> None:
    """A ring of ``radius`` metres around the event that the views look at, as long as its mark is there."""
    angle = np.linspace(0.0, 2 * np.pi, 49)
    x, y, z = at.position
    ring = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), np.full(len(angle), z)])
    end = at.frame + EVENT_FRAMES
    frames = np.arange(at.frame, min(end + 1, scene.frames))
    drawn = (frames < end).astype(int)  # the frame after it clears the ring
    lines = np.repeat(ring[None], drawn.sum(), axis=0).astype(np.float32)
    style = rr.LineStrips3D.from_fields(radii=EDGE, colors=SWITCH)
    columns = rr.LineStrips3D.columns(strips=lines).partition(drawn)
    Log(recording, frame_times(scene, frames)).columns("world/at", style, columns)


def lanes(replay: Replay) -> dict[int, dict[int, int | None]]:
    """Identity lane of each evaluated object, by its id: the track of the best hypothesis that follows it.

    A lane has the track from each frame on at which it changes: -1 untracked, None while the object is absent.
    """
    truth = replay.scene.truth
    frame, evaluated = truth.frame_of_rows, ~truth.neutral
    track = np.append(replay.rollout.track_id, -1)[replay.truth_track]
    lanes = {}
    for object_id in np.unique(truth.object_id[evaluated]).tolist():
        rows = np.flatnonzero(evaluated & (truth.object_id == object_id))
        lane: dict[int, int | None] = {}
        current: int | None = None
        following = np.append(frame[rows][1:], replay.frames)
        for t, after, own in zip(frame[rows].tolist(), following.tolist(), track[rows].tolist(), strict=True):
            if own != current:
                lane[t] = current = own
            if after > t + 1:
                lane[t + 1] = current = None
        lanes[object_id] = lane
    return lanes


def _log_lane(log: Log, scene: Scene, object_id: int, lane: dict[int, int | None]) -> None:
    tracks = np.array(sorted({track for track in lane.values() if track is not None}))
    colors = np.where(tracks[:, None] < 0, UNTRACKED, track_colors(tracks))
    names = [_state(track) for track in tracks.tolist()]
    labels = [name.removeprefix("track ") for name in names]
    style = rr.StateConfiguration(values=names, labels=labels, colors=packed(colors))
    columns = rr.StateChange.columns(state=[_state(track) for track in lane.values()])
    own = Log(log.recording, frame_times(scene, np.array(list(lane))), log.root)
    own.columns(f"identity/gt_{object_id:03d}", style, columns)


def _state(track: int | None) -> str:
    if track is None:
        return ""
    return "untracked" if track < 0 else f"track {track}"
