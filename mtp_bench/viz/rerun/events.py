"""Judgement of a run in a recording: events, identity lanes, curves of the error."""

from collections.abc import Sequence
from io import BytesIO
from typing import NamedTuple

import numpy as np

from ...core import Floats, Ints, starts_of, unit_vectors
from ...scoring import LEAST_SHOWN, PARTS
from ..causes import cause_text, causes_of, happened
from ..drawing.report import report
from ..evidence import gate
from ..focus import Focus
from ..framing import frames_around, length_of
from ..incident import INCIDENT_KINDS, Incident
from ..palette import BLUE, FROM_EVENT, ORANGE, PURPLE, VERMILLION, Color
from ..run_replay import Replay
from .entities import EDGE_M, Log
from .sdk import rr
from .shown import (
    EVENTS,
    SKY,
    SWITCH,
    UNKNOWN,
    UNTRACKED,
    Colors,
    ShownAgent,
    drawable,
    track_colors,
)

EVENT_FRAMES = 10  # frames that an event stays in the picture
MARK_SECONDS = 1.0  # that a mark on the time line lasts at least: room for its name
MAX_CURVES = 4  # parts or tracks in a plot: the legend has no more room
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
    (140, 150, 70),
)
MARKER_M = (0.0, 3.4, 3.0)  # from an event to its mark: beside the label of the box


def log_judgement(log: Log, agent: ShownAgent) -> None:
    """Log events and identity lanes of the best hypothesis, and curves."""
    replay = agent.replay
    _log_markers(log, replay)
    _log_curves(log, replay, agent.focus)
    for kind in INCIDENT_KINDS:
        incidents = [event for event in replay.incidents if event.kind == kind]
        if incidents:
            _log_marks(log, kind, replay, incidents)
    for object_id, tracks in lanes(replay).items():
        track_ids = np.array([-1 if track is None else track for track in tracks])
        colors = track_colors(track_ids)
        colors[track_ids < 0] = UNTRACKED
        states = [_track_state(track) for track in tracks]
        _log_lane(log, agent.lanes[object_id], states, colors)


def _track_state(track: int | None) -> str:
    if track is None:
        return ""
    return "untracked" if track < 0 else f"track {track}"


def log_focus(log: Log, focuses: Sequence[Focus], focus: Focus) -> None:
    """Log picture, causes and ring of an event."""
    png = BytesIO()
    report(focus, focuses).save(png, format="PNG")
    picture = rr.EncodedImage(contents=png.getvalue(), media_type="image/png")
    log.recording.log(f"{log.root}focus/picture", picture, static=True)
    text = rr.TextDocument(drawable(event_text(focus)), media_type="text/markdown")
    log.recording.log(f"{log.root}focus/text", text, static=True)
    if focus is focuses[0]:  # one ring for all runs
        radius_m = 0.4 + 0.65 * length_of(focus)  # more than half of it
        circle = radius_m * unit_vectors(np.linspace(0.0, 2 * np.pi, 49))
        position = focus.at.position
        ring = np.insert(circle + position[:2], 2, position[2], axis=1)
        shape = rr.LineStrips3D([ring], radii=EDGE_M, colors=SWITCH)
        log.recording.log("world/at", shape, static=True)


def event_text(focus: Focus) -> str:
    """Return an event and the table of its causes as Markdown."""
    lines = [
        f"##### {happened(focus)}",
        "",
        "| cause | m | evidence |",
        "|---|--:|---|",
    ]
    for cause in causes_of(focus):
        cost = "" if cause.cost_m is None else f"{cause.cost_m:.1f}"
        lines.append(f"| {cause.title} | {cost} | {cause_text(cause)} |")
    return "\n".join(lines)


def _log_markers(log: Log, replay: Replay) -> None:
    """Log the places of events, for some frames after."""
    frame_events = [replay.recent(t, EVENT_FRAMES) for t in range(replay.frames)]
    events = [event for recent in frame_events for event in recent]
    if events:
        places = np.array([event.position for event in events]) + MARKER_M
        labels = [f"{event.name}: {event.label}" for event in events]
        colors = np.array([EVENTS[event.kind] for event in events], dtype=np.uint8)
        row_start = starts_of([len(recent) for recent in frame_events])
        log.names("world/events", row_start, places, colors, labels, 6.0)


def _log_marks(
    log: Log, kind: str, replay: Replay, incidents: Sequence[Incident]
) -> None:
    """Log names of events on the time line."""
    names: list[list[str]] = [[] for _ in range(replay.frames)]
    time = replay.scene.time
    for event in incidents:
        end = int(np.searchsorted(time, time[event.frame] + MARK_SECONDS))
        for t in range(event.frame, max(event.until + 1, end)):
            names[t].append(event.name)
    states = [", ".join(frame_names) for frame_names in names]
    colors = np.full((len(states), 3), EVENTS[kind], dtype=np.uint8)
    _log_lane(log, f"marks/{kind}", states, colors)


def lanes(replay: Replay) -> dict[int, list[int | None]]:
    """Return the identity lane [F] of each object by number.

    It has the track of the best hypothesis that follows the object: -1 while it is
    untracked, None while it is absent.
    """
    truth = replay.scene.truth
    frames = truth.frame_of_rows.tolist()
    tracks = np.append(replay.rollout.track_id, -1)[replay.truth_track].tolist()
    object_lanes: dict[int, list[int | None]] = {}
    for row in np.lexsort((truth.object_id,)).tolist():  # lanes are in this order
        if not truth.neutral[row]:
            object_id = int(truth.object_id[row])
            lane = object_lanes.setdefault(object_id, [None] * replay.frames)
            lane[frames[row]] = tracks[row]
    return object_lanes


def _log_lane(
    log: Log, entity_path: str, states: Sequence[str], colors: Colors
) -> None:
    """Log where the states [F] of a lane change, with their colours [F, 3].

    The state "" is not shown.
    """
    color_of_state = dict(zip(states, colors.tolist(), strict=True))
    color_of_state.pop("", None)
    names = list(color_of_state)
    style = rr.StateConfiguration(
        values=names,
        labels=names,
        colors=np.array(list(color_of_state.values()), dtype=np.uint8),
    )
    first = log.frames.start
    changes = [t for t in log.frames if t == first or states[t] != states[t - 1]]
    columns = rr.StateChange.columns(state=[states[t] for t in changes])
    log.columns(entity_path, style, columns, changes)


# ---- curves


class Curve(NamedTuple):
    """One line of a plot."""

    name: str
    values: Floats  # [F], NaN where unknown
    color: Color
    width: float = 2.0


def curves_of(replay: Replay, focus: Focus | None) -> dict[str, list[Curve]]:
    """Return curves by the titles of their plots: of an object, else of the scene."""
    if focus is None or focus.at.object_id < 0:  # a false forecast has no error
        part = np.full((replay.frames, len(PARTS)), np.nan)
        is_target = np.isfinite(replay.part[:, 0])
        frame = replay.scene.truth.frame_of_rows
        for t in np.unique(frame[is_target]):
            part[t] = replay.part[is_target & (frame == t)].mean(axis=0)
        errors = _error_curves(part, range(replay.frames))
        return {"mean error of the targets, m": errors}
    at = focus.at
    part = np.where(focus.rows[:, None] >= 0, replay.part[focus.rows], np.nan)
    max_error = replay.card.per_class(replay.card.task.miss_error)[at.class_id]
    rule = gate(focus)
    gate_m = np.nan if rule.by_iou else rule.threshold
    frames = frames_around(replay.scene, at.frame)
    true_place = _places(replay.scene.truth.box, focus.rows)
    distances = []
    for track_id in focus.tracks_at(at.frame)[:MAX_CURVES]:
        rows = focus.track_rows(track_id)
        offset_m = _places(replay.rollout.track_box, rows) - true_place
        color = PURPLE
        if track_id == at.new_id:
            color = FROM_EVENT
        elif track_id == at.old_id:
            color = SKY
        distances.append(Curve(f"track {track_id}", np.hypot(*offset_m.T), color))
    return {
        f"error of {focus.named}, m": [
            _limit("largest error, c", max_error, replay.frames),
            *_error_curves(part, frames),
        ],
        f"distance of tracks to {focus.named}, m": [
            _limit("event gate", gate_m, replay.frames),
            *distances,
        ],
    }


def _limit(name: str, value: float, frames: int) -> Curve:
    return Curve(name, np.full(frames, value), LIMIT, 1.0)


def _places(box: Floats, rows: Ints) -> Floats:
    """Return places [F, 2] of ``rows`` [F], NaN for -1."""
    places = np.append(box[:, :2].astype(np.float64), [[np.nan, np.nan]], axis=0)
    return places[rows]


def _error_curves(part: Floats, frames: range) -> list[Curve]:
    """Return the error and its largest parts in ``frames``."""
    largest = np.nan_to_num(np.abs(part))[frames].max(axis=0)
    curves = [Curve("error", part.sum(axis=1), SWITCH, 5.0)]
    for column in np.argsort(-largest, kind="stable")[:MAX_CURVES].tolist():
        if largest[column] >= LEAST_SHOWN:
            color = PART_COLORS[column]
            curves.append(Curve(PARTS[column], part[:, column], color))
    return curves


def _log_curves(log: Log, replay: Replay, focus: Focus | None) -> None:
    for number, curves in enumerate(curves_of(replay, focus).values()):
        for i, curve in enumerate(curves):
            values = curve.values[log.frames]
            is_known = np.isfinite(values)  # a frame without a value is a gap
            style = rr.SeriesLines(
                colors=curve.color,
                names=drawable(curve.name),
                widths=curve.width,
            )
            columns = rr.Scalars.columns(scalars=values[is_known])
            columns = columns.partition(is_known.astype(int))
            log.columns(f"curves/{number}/{i:02d}", style, columns)
