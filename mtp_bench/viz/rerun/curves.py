"""Curves of the object of an event over frames: its error and the parts of it, distances and speeds of its tracks."""

from typing import NamedTuple

import numpy as np

from ...scoring.parts import LEAST_SHOWN, PARTS
from ...types import Floats
from ..evidence import gate
from ..focus import Focus
from ..palette import BLUE, ORANGE, PURPLE, TRUTH, VERMILLION, Color
from .colors import ROLES, SKY, SWITCH, UNKNOWN, packed
from .entities import Log
from .sdk import rr

MOST_TRACKS, MOST_PARTS = 4, 4  # of a plot: the legend has no more room
LIMIT: Color = (130, 130, 130)
PART_COLORS: tuple[Color, ...] = (  # of `PARTS`, in their order
    BLUE, (0, 150, 150), PURPLE, VERMILLION, UNKNOWN, (90, 115, 160), (166, 112, 0), ORANGE, SKY, (120, 94, 240),
    (215, 60, 60),
)  # fmt: skip


class Curve(NamedTuple):
    """One line of a plot."""

    name: str
    values: Floats  # [F], NaN where unknown
    color: Color
    width: float = 2.0


def curves_of(focus: Focus) -> dict[str, list[Curve]]:
    """Curves by the title of their plot; a plot without any is left out."""
    noun = focus.named if focus.at.object_id >= 0 else "the false forecast"
    plots = {
        f"error of {focus.named}, m": _errors(focus),
        "confidence of the false forecast": _confidence(focus),
        f"distance of tracks to {noun}, m": _distances(focus),
        "speed, m/s": _speeds(focus),
    }
    known = {title: [c for c in curves if np.isfinite(c.values).any()] for title, curves in plots.items()}
    return {title: curves for title, curves in known.items() if curves}


def log_curves(log: Log, focus: Focus) -> None:
    """Log all curves, and the events of the object as points on its error."""
    for number, curves in enumerate(curves_of(focus).values()):
        for i, curve in enumerate(curves):
            style = rr.SeriesLines(colors=packed(curve.color), names=curve.name, widths=curve.width)
            values = curve.values[log.frames]
            known = np.isfinite(values)  # a frame without a value is a gap
            columns = rr.Scalars.columns(scalars=values[known]).partition(known.astype(int))
            log.columns(f"object/{number}/{i:02d}", style, columns)


def _errors(focus: Focus) -> list[Curve]:
    """The error of the object, the largest possible one, and the parts that are ever shown."""
    run, rows, task = focus.replay, focus.rows, focus.replay.card.task
    if (rows < 0).all():
        return []
    part = np.where(rows[:, None] >= 0, run.part[rows], np.nan)
    largest = run.card.per_class(task.miss_error)[focus.at.class_id]
    curves = [
        Curve("largest error, c", np.full(run.frames, largest), LIMIT, 1.0),
        Curve("error", part.sum(axis=1), SWITCH, 5.0),
    ]
    most = np.nan_to_num(np.abs(part)).max(axis=0)
    shown = [i for i in np.argsort(-most, kind="stable")[:MOST_PARTS].tolist() if most[i] >= LEAST_SHOWN]
    return curves + [Curve([*PARTS.values()][i], part[:, i], PART_COLORS[i]) for i in shown]


def _confidence(focus: Focus) -> list[Curve]:
    """Confidence of the track's forecasts, for a false forecast."""
    run = focus.replay
    if focus.at.object_id >= 0 or focus.at.new_id < 0:
        return []
    own, frame = run.answers.object_track_id == focus.at.new_id, run.rollout.objects.frame_of_rows
    values = np.full(run.frames, np.nan)
    values[frame[own]] = run.rollout.object_confidence[own]
    return [Curve(f"track {focus.at.new_id}", values, ROLES["now"])]


def _places(focus: Focus) -> list[tuple[str, Floats, Color]]:
    """Places [F, 2] of the object and of the tracks of the event, NaN where they are not, each with name and colour."""
    truth, rollout, at = focus.replay.scene.truth.box, focus.replay.rollout.track_box.astype(np.float64), focus.at
    tables = [(focus.named, truth, focus.rows, TRUTH)] if at.object_id >= 0 else []
    for track_id in focus.named_tracks[:MOST_TRACKS]:
        role = {at.old_id: "before", at.new_id: "now"}.get(track_id, "named")
        tables.append((f"track {track_id}", rollout, focus.track_rows(track_id), ROLES[role]))
    nowhere = np.full((1, 2), np.nan)  # row -1
    return [(name, np.append(box[:, :2], nowhere, axis=0)[rows], color) for name, box, rows, color in tables]


def _distances(focus: Focus) -> list[Curve]:
    """Distances of the tracks to the object, and the event gate."""
    if focus.at.object_id < 0:
        return []
    (_, truth, _), *tracks = _places(focus)
    rule = gate(focus)
    limit = [] if rule.iou else [Curve("event gate", np.full(len(truth), rule.threshold), LIMIT, 1.0)]
    return limit + [Curve(name, np.hypot(*(place - truth).T), color) for name, place, color in tracks]


def _speeds(focus: Focus) -> list[Curve]:
    """Speeds of the object and of the tracks."""
    step = np.diff(focus.replay.scene.time)
    speeds = ((name, np.hypot(*np.diff(place, axis=0).T) / step, color) for name, place, color in _places(focus))
    return [Curve(name, np.append(np.nan, speed), color) for name, speed, color in speeds]
