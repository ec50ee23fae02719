"""Judgement of a run in a recording: events on the time line and identity lanes of the best hypothesis."""

import itertools
from collections.abc import Sequence

import numpy as np

from ...types import starts_of
from ..focus import Focus
from ..replay import KINDS, MOMENT, Incident, Replay
from ..sentence import sentence
from .colors import EVENTS, UNKNOWN, UNTRACKED, Colors, packed, track_colors
from .entities import Log
from .sdk import rr
from .shown import ShownAgent, drawable

EVENT_FRAMES = 10  # frames that an event stays in the picture
EVENT_SECONDS = 1.0  # that its mark on the time line lasts at least: so its name has room
MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box


def log_judgement(log: Log, agent: ShownAgent) -> None:
    """Log events and identity lanes of the best hypothesis."""
    run = agent.replay
    _log_markers(log, run)
    groups = {f"marks/{kind}": [i for i in run.incidents if i.kind == kind] for kind in KINDS}
    if agent.focus is not None and agent.focus.at.object_id in agent.lanes:
        at = agent.focus.at
        own = [i for i in run.events if i.object_id == at.object_id]
        groups[f"{agent.lanes[at.object_id]}-events"] = own + [at] * (at.kind == MOMENT)
    for path, incidents in groups.items():
        marks = marks_of(run, incidents)
        names = sorted({*marks} - {""})
        kinds = {drawable(i.name): EVENTS.get(i.kind, UNKNOWN) for i in incidents}
        colors = np.array([kinds[name.partition(", ")[0]] for name in names], dtype=np.uint8)
        if incidents:
            _log_lane(log, path, marks, names, colors)
        happened = [i for i in incidents if i.frame in log.frames and path.startswith("marks")]
        if happened:
            texts = [drawable(sentence(Focus(run, i))) for i in happened]
            color = packed(np.array([EVENTS[i.kind] for i in happened], dtype=np.uint8))
            columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=color)
            log.columns(path, None, columns, [i.frame for i in happened])
    for object_id, lane in lanes(run).items():
        tracks = np.unique([track for track in lane if track is not None])
        names = ["untracked" if track < 0 else f"track {track}" for track in tracks.tolist()]
        states = ["" if track is None else names[np.searchsorted(tracks, track)] for track in lane]
        colors = np.where(tracks[:, None] < 0, UNTRACKED, track_colors(tracks)).astype(np.uint8)
        _log_lane(log, agent.lanes[object_id], states, names, colors)


def _log_markers(log: Log, run: Replay) -> None:
    """Log the places of events, for some frames after."""
    now = [run.recent(t, EVENT_FRAMES) for t in range(run.frames)]
    incidents = list(itertools.chain.from_iterable(now))
    if incidents:
        place, labels = np.array([i.position for i in incidents]) + MARKER, [f"{i.name}: {i.label}" for i in incidents]
        colors = np.array([EVENTS[i.kind] for i in incidents], dtype=np.uint8)
        log.names("world/events", starts_of([len(each) for each in now]), place, colors, labels, 6.0)


def marks_of(run: Replay, incidents: Sequence[Incident]) -> list[str]:
    """Names of the events that are marked on the time line in each frame [F], "" without one."""
    names: list[list[str]] = [[] for _ in range(run.frames)]
    for incident in incidents:
        first = incident.frame if incident.first < 0 else incident.first
        end = int(np.searchsorted(run.scene.time, run.scene.time[incident.frame] + EVENT_SECONDS))
        for t in range(first, max(incident.until + 1, end)):
            names[t].append(drawable(incident.name))
    return [", ".join(each) for each in names]


def lanes(run: Replay) -> dict[int, list[int | None]]:
    """Identity lane of each evaluated object, by its number: the track [F] of the best hypothesis that follows it.

    It is -1 while the object is untracked, None while it is absent.
    """
    truth = run.scene.truth
    frame, evaluated = truth.frame_of_rows, ~truth.neutral
    track = np.append(run.rollout.track_id, -1)[run.truth_track]
    lanes: dict[int, list[int | None]] = {}
    for object_id in np.unique(truth.object_id[evaluated]).tolist():
        rows = np.flatnonzero(evaluated & (truth.object_id == object_id))
        tracks = dict(zip(frame[rows].tolist(), track[rows].tolist(), strict=True))
        lanes[object_id] = [tracks.get(t) for t in range(run.frames)]
    return lanes


def _log_lane(log: Log, path: str, states: Sequence[str], values: Sequence[str], colors: Colors) -> None:
    """Log a lane with a state in each frame [F], "" for none; ``values`` have these ``colors``."""
    style = rr.StateConfiguration(values=values, labels=values, colors=packed(colors))
    changes = [t for t in log.frames if t == log.frames.start or states[t] != states[t - 1]]
    log.columns(path, style, rr.StateChange.columns(state=[states[t] for t in changes]), changes)
