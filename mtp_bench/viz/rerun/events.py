"""Judgement of a run in a recording: events, identity lanes and counts of the best hypothesis."""

import itertools

import numpy as np

from ...types import Scene
from ..focus import Focus
from ..replay import KINDS, Replay
from ..sentence import sentence
from .colors import EVENTS, SERIES, UNTRACKED, packed, tone, track_colors
from .entities import Log, frame_times
from .sdk import rr
from .shown import ShownAgent

EVENT_FRAMES = 10  # frames that an event stays in the picture
MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box


def log_judgement(log: Log, agent: ShownAgent, number: int) -> None:
    """Log events, identity lanes and counts of the best hypothesis of the agent with this number."""
    run = agent.replay
    _log_markers(log, run)
    _log_texts(log, run)
    for object_id, lane in lanes(run).items():
        _log_lane(log, run.scene, object_id, lane)
    counts = {name: count for name, count in run.counts.items() if name != "FP" or run.scene.truth_complete}
    for kind in KINDS[:-1]:  # numbers of events until each frame
        happened = np.bincount([i.frame for i in run.events if i.kind == kind], minlength=run.frames)
        counts[kind] = np.cumsum(happened)
    for name, values in counts.items():
        color = packed(tone(SERIES[name], number))
        style = rr.SeriesLines(colors=color, names=f"{agent.name} {name}".strip(), widths=2)
        log.columns(f"metrics/{name}", style, rr.Scalars.columns(scalars=values.astype(np.float64)))


def _log_texts(log: Log, run: Replay) -> None:
    """Log the sentences of the events."""
    for kind in KINDS:
        incidents = [i for i in run.incidents if i.kind == kind]
        if incidents:
            texts = [sentence(Focus(run, incident)) for incident in incidents]
            colors = np.tile(packed(EVENTS[kind]), len(texts))
            columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
            times = frame_times(run.scene, np.array([i.frame for i in incidents]))
            log.recording.send_columns(f"{log.root}events/{kind}", times, columns)


def _log_markers(log: Log, run: Replay) -> None:
    """Log the places of events, for some frames after."""
    now = [run.recent(t, EVENT_FRAMES) for t in range(run.frames)]
    incidents = list(itertools.chain.from_iterable(now))
    if incidents:
        columns = rr.Points3D.columns(
            positions=np.array([i.position for i in incidents]) + MARKER,
            colors=packed(np.array([EVENTS[i.kind] for i in incidents], dtype=np.uint8)),
            labels=[f"{i.name}: {i.label}" for i in incidents],
        )
        style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(6.0), show_labels=True)
        log.columns("world/events", style, columns.partition([len(each) for each in now]))


def lanes(run: Replay) -> dict[int, dict[int, int | None]]:
    """Identity lane of each evaluated object, by its id: the track of the best hypothesis that follows it.

    A lane has the track from each frame on at which it changes: -1 untracked, None while the object is absent.
    """
    truth = run.scene.truth
    frame, evaluated = truth.frame_of_rows, ~truth.neutral
    track = np.append(run.rollout.track_id, -1)[run.truth_track]
    lanes = {}
    for object_id in np.unique(truth.object_id[evaluated]).tolist():
        rows = np.flatnonzero(evaluated & (truth.object_id == object_id))
        tracks = dict(zip(frame[rows].tolist(), track[rows].tolist(), strict=True))
        series = [tracks.get(t) for t in range(run.frames)]
        changes = zip([None, *series], series, strict=False)
        lanes[object_id] = {t: new for t, (old, new) in enumerate(changes) if new != old}
    return lanes


def _log_lane(log: Log, scene: Scene, object_id: int, lane: dict[int, int | None]) -> None:
    names = {track: "untracked" if track < 0 else f"track {track}" for track in lane.values() if track is not None}
    tracks = np.array(sorted(names))
    colors = np.where(tracks[:, None] < 0, UNTRACKED, track_colors(tracks))
    values = [names[track] for track in tracks.tolist()]
    labels = [name.removeprefix("track ") for name in values]
    style = rr.StateConfiguration(values=values, labels=labels, colors=packed(colors))
    columns = rr.StateChange.columns(state=["" if track is None else names[track] for track in lane.values()])
    own = Log(log.recording, frame_times(scene, np.array(list(lane))), log.root)
    own.columns(f"identity/gt_{object_id:03d}", style, columns)
