"""Judgement of a run in a recording: events on the time line, identity lanes, curves of the error and its parts."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...core import Floats, Ints, starts_of
from ...scoring import LEAST_SHOWN, PARTS
from ..evidence import gate
from ..focus import Focus
from ..framing import frames_around
from ..incident import INCIDENT_KINDS, MOMENT, Incident
from ..palette import BLUE, ORANGE, PURPLE, TRUTH, VERMILLION, Color
from ..run_replay import Replay
from ..sentences import sentence
from .entities import Log
from .sdk import rr
from .shown import (
    EVENTS,
    ROLES,
    SKY,
    SWITCH,
    UNKNOWN,
    UNTRACKED,
    Colors,
    ShownAgent,
    drawable,
    packed,
    track_colors,
)

EVENT_FRAMES = 10  # frames that an event stays in the picture
EVENT_SECONDS = (
    1.0  # that its mark on the time line lasts at least: so its name has room
)
MOST = 4  # parts or tracks in a plot: the legend has no more room
LIMIT = (130, 130, 130)
PART_COLORS: tuple[Color, ...] = (  # of `PARTS`, in their order
    BLUE,
    (0, 150, 150),
    PURPLE,
    VERMILLION,
    UNKNOWN,
    (90, 115, 160),
    (166, 112, 0),
    ORANGE,
    SKY,
    (120, 94, 240),
    (215, 60, 60),
)
MARKER = (0.0, 3.4, 3.0)  # m, from an event to its mark: beside the label of the box


def log_judgement(log: Log, agent: ShownAgent) -> None:
    """Log events and identity lanes of the best hypothesis, and curves."""
    run = agent.replay
    _log_markers(log, run)
    _log_curves(log, run, agent.focus)
    groups = {
        f"marks/{kind}": [i for i in run.incidents if i.kind == kind]
        for kind in INCIDENT_KINDS
    }
    if agent.focus is not None and agent.focus.at.object_id in agent.lanes:
        at = agent.focus.at
        own = [i for i in run.events if i.object_id == at.object_id]
        groups[f"{agent.lanes[at.object_id]}-events"] = own + [at] * (at.kind == MOMENT)
    for path, incidents in groups.items():
        marks = marks_of(run, incidents)
        names = sorted({*marks} - {""})
        kinds = {drawable(i.name): EVENTS.get(i.kind, UNKNOWN) for i in incidents}
        colors = np.array(
            [kinds[name.partition(", ")[0]] for name in names], dtype=np.uint8
        )
        if incidents:
            _log_lane(log, path, marks, names, colors)
        happened = [
            i for i in incidents if i.frame in log.frames and path.startswith("marks")
        ]
        if happened:
            texts = [drawable(sentence(Focus(run, i))) for i in happened]
            color = packed(np.array([EVENTS[i.kind] for i in happened], dtype=np.uint8))
            columns = rr.TextLog.columns(
                text=texts, level=["INFO"] * len(texts), color=color
            )
            log.columns(path, None, columns, [i.frame for i in happened])
    for object_id, lane in lanes(run).items():
        tracks = np.unique([track for track in lane if track is not None])
        names = [
            "untracked" if track < 0 else f"track {track}" for track in tracks.tolist()
        ]
        states = [
            "" if track is None else names[np.searchsorted(tracks, track)]
            for track in lane
        ]
        colors = np.where(tracks[:, None] < 0, UNTRACKED, track_colors(tracks)).astype(
            np.uint8
        )
        _log_lane(log, agent.lanes[object_id], states, names, colors)


def _log_markers(log: Log, run: Replay) -> None:
    """Log the places of events, for some frames after."""
    now = [run.recent(t, EVENT_FRAMES) for t in range(run.frames)]
    incidents = list(itertools.chain.from_iterable(now))
    if incidents:
        place, labels = (
            np.array([i.position for i in incidents]) + MARKER,
            [f"{i.name}: {i.label}" for i in incidents],
        )
        colors = np.array([EVENTS[i.kind] for i in incidents], dtype=np.uint8)
        log.names(
            "world/events",
            starts_of([len(each) for each in now]),
            place,
            colors,
            labels,
            6.0,
        )


def marks_of(run: Replay, incidents: Sequence[Incident]) -> list[str]:
    """Names of the events that are marked on the time line in each frame [F], "" without one."""
    names: list[list[str]] = [[] for _ in range(run.frames)]
    for incident in incidents:
        first = incident.frame if incident.first < 0 else incident.first
        end = int(
            np.searchsorted(
                run.scene.time, run.scene.time[incident.frame] + EVENT_SECONDS
            )
        )
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


def _log_lane(
    log: Log, path: str, states: Sequence[str], values: Sequence[str], colors: Colors
) -> None:
    """Log a lane with a state in each frame [F], "" for none; ``values`` have these ``colors``."""
    style = rr.StateConfiguration(values=values, labels=values, colors=packed(colors))
    changes = [
        t for t in log.frames if t == log.frames.start or states[t] != states[t - 1]
    ]
    log.columns(
        path, style, rr.StateChange.columns(state=[states[t] for t in changes]), changes
    )


class Curve(NamedTuple):
    """One line of a plot."""

    name: str
    values: Floats  # [F], NaN where unknown
    color: Color
    width: float = 2.0


def curves_of(run: Replay, focus: Focus | None) -> dict[str, list[Curve]]:
    """Curves by the title of their plot: those of an event, or without one the mean error of the targets."""
    if focus is None:
        targets = np.flatnonzero(np.isfinite(run.part[:, 0]))
        total, frame = (
            np.full((run.frames, len(PARTS)), np.nan),
            run.scene.truth.frame_of_rows[targets],
        )
        for t in np.unique(frame):
            total[t] = run.part[targets[frame == t]].mean(axis=0)
        return {"mean error of the targets, m": _errors(total, range(run.frames))}
    at = focus.at
    places = {
        f"track {i}": _places(run.rollout.track_box, focus.track_rows(i))
        for i in focus.named_tracks[:MOST]
    }
    colors = {f"track {i}": ROLES["named"] for i in focus.named_tracks}
    colors |= {
        f"track {at.old_id}": ROLES["before"],
        f"track {at.new_id}": ROLES["now"],
        focus.named: TRUTH,
    }
    plots: dict[str, list[Curve]] = {}
    if at.object_id >= 0:
        part = np.where(focus.rows[:, None] >= 0, run.part[focus.rows], np.nan)
        largest, rule = (
            run.card.per_class(run.card.task.miss_error)[at.class_id],
            gate(focus),
        )
        limit = Curve("largest error, c", np.full(run.frames, largest), LIMIT, 1.0)
        plots[f"error of {focus.named}, m"] = [
            limit,
            *_errors(part, frames_around(run.scene, at.frame)),
        ]
        truth = _places(run.scene.truth.box, focus.rows)
        gaps = [
            Curve(name, np.hypot(*(place - truth).T), colors[name])
            for name, place in places.items()
        ]
        limit = Curve(
            "event gate",
            np.full(run.frames, np.nan if rule.iou else rule.threshold),
            LIMIT,
            1.0,
        )
        plots[f"distance of tracks to {focus.named}, m"] = [limit, *gaps]
        places[focus.named] = truth
    elif at.new_id >= 0:
        own, confidence = (
            run.answers.object_track_id == at.new_id,
            np.full(run.frames, np.nan),
        )
        confidence[run.rollout.objects.frame_of_rows[own]] = (
            run.rollout.object_confidence[own]
        )
        plots["confidence of the false forecast"] = [
            Curve(f"track {at.new_id}", confidence, ROLES["now"])
        ]
    step = np.diff(run.scene.time, prepend=np.nan)
    speeds = {
        name: np.hypot(*np.diff(place, axis=0, prepend=np.nan).T) / step
        for name, place in places.items()
    }
    plots["speed, m/s"] = [
        Curve(name, speed, colors[name]) for name, speed in speeds.items()
    ]
    return plots


def _places(box: Floats, rows: Ints) -> Floats:
    """Places [F, 2] of the boxes in ``rows`` [F], NaN for row -1."""
    return np.append(box[:, :2].astype(np.float64), np.full((1, 2), np.nan), axis=0)[
        rows
    ]


def _errors(part: Floats, frames: range) -> list[Curve]:
    """The error and the largest parts in ``frames``, from all parts [F, len(PARTS)]."""
    most = np.nan_to_num(np.abs(part))[frames].max(axis=0)
    shown = [
        i
        for i in np.argsort(-most, kind="stable")[:MOST].tolist()
        if most[i] >= LEAST_SHOWN
    ]
    parts = [Curve([*PARTS.values()][i], part[:, i], PART_COLORS[i]) for i in shown]
    return [Curve("error", part.sum(axis=1), SWITCH, 5.0), *parts]


def _log_curves(log: Log, run: Replay, focus: Focus | None) -> None:
    for number, curves in enumerate(curves_of(run, focus).values()):
        for i, curve in enumerate(curves):
            values = curve.values[log.frames]
            known = np.isfinite(values)  # a frame without a value is a gap
            style = rr.SeriesLines(
                colors=packed(curve.color),
                names=drawable(curve.name),
                widths=curve.width,
            )
            columns = rr.Scalars.columns(scalars=values[known]).partition(
                known.astype(int)
            )
            log.columns(f"curves/{number}/{i:02d}", style, columns)
