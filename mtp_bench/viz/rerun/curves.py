"""Curves over frames: the error and its parts; of the object of an event also distances and speeds of its tracks."""

from typing import NamedTuple

import numpy as np

from ...scoring.parts import LEAST_SHOWN, PARTS
from ...types import Floats, Ints
from ..evidence import gate
from ..focus import Focus
from ..palette import BLUE, ORANGE, PURPLE, TRUTH, VERMILLION, Color
from ..replay import Replay
from .colors import ROLES, SKY, SWITCH, UNKNOWN, packed
from .entities import Log, frames_around
from .sdk import rr

MOST = 4  # parts or tracks in a plot: the legend has no more room
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


def curves_of(run: Replay, focus: Focus | None) -> dict[str, list[Curve]]:
    """Curves by the title of their plot: those of an event, or without one the mean error of the targets."""
    if focus is None:
        targets = np.flatnonzero(np.isfinite(run.part[:, 0]))
        total, frame = np.full((run.frames, len(PARTS)), np.nan), run.scene.truth.frame_of_rows[targets]
        for t in np.unique(frame):
            total[t] = run.part[targets[frame == t]].mean(axis=0)
        return {"mean error of the targets, m": _errors(total, range(run.frames))}
    at = focus.at
    places = {f"track {i}": _places(run.rollout.track_box, focus.track_rows(i)) for i in focus.named_tracks[:MOST]}
    colors = {f"track {i}": ROLES["named"] for i in focus.named_tracks}
    colors |= {f"track {at.old_id}": ROLES["before"], f"track {at.new_id}": ROLES["now"], focus.named: TRUTH}
    plots: dict[str, list[Curve]] = {}
    if at.object_id >= 0:
        part = np.where(focus.rows[:, None] >= 0, run.part[focus.rows], np.nan)
        largest, rule = run.card.per_class(run.card.task.miss_error)[at.class_id], gate(focus)
        limit = Curve("largest error, c", np.full(run.frames, largest), LIMIT, 1.0)
        plots[f"error of {focus.named}, m"] = [limit, *_errors(part, frames_around(run.scene, at.frame))]
        truth = _places(run.scene.truth.box, focus.rows)
        gaps = [Curve(name, np.hypot(*(place - truth).T), colors[name]) for name, place in places.items()]
        limit = Curve("event gate", np.full(run.frames, np.nan if rule.iou else rule.threshold), LIMIT, 1.0)
        plots[f"distance of tracks to {focus.named}, m"] = [limit, *gaps]
        places[focus.named] = truth
    elif at.new_id >= 0:
        own, confidence = run.answers.object_track_id == at.new_id, np.full(run.frames, np.nan)
        confidence[run.rollout.objects.frame_of_rows[own]] = run.rollout.object_confidence[own]
        plots["confidence of the false forecast"] = [Curve(f"track {at.new_id}", confidence, ROLES["now"])]
    step = np.diff(run.scene.time, prepend=np.nan)
    speeds = {name: np.hypot(*np.diff(place, axis=0, prepend=np.nan).T) / step for name, place in places.items()}
    plots["speed, m/s"] = [Curve(name, speed, colors[name]) for name, speed in speeds.items()]
    return plots


def _places(box: Floats, rows: Ints) -> Floats:
    """Places [F, 2] of the boxes in ``rows`` [F], NaN for row -1."""
    return np.append(box[:, :2].astype(np.float64), np.full((1, 2), np.nan), axis=0)[rows]


def _errors(part: Floats, frames: range) -> list[Curve]:
    """The error and the largest parts in ``frames``, from all parts [F, len(PARTS)]."""
    most = np.nan_to_num(np.abs(part))[frames].max(axis=0)
    shown = [i for i in np.argsort(-most, kind="stable")[:MOST].tolist() if most[i] >= LEAST_SHOWN]
    parts = [Curve([*PARTS.values()][i], part[:, i], PART_COLORS[i]) for i in shown]
    return [Curve("error", part.sum(axis=1), SWITCH, 5.0), *parts]


def log_curves(log: Log, run: Replay, focus: Focus | None) -> None:
    """Log all curves."""
    for number, curves in enumerate(curves_of(run, focus).values()):
        for i, curve in enumerate(curves):
            values = curve.values[log.frames]
            known = np.isfinite(values)  # a frame without a value is a gap
            style = rr.SeriesLines(colors=packed(curve.color), names=curve.name, widths=curve.width)
            columns = rr.Scalars.columns(scalars=values[known]).partition(known.astype(int))
            log.columns(f"curves/{number}/{i:02d}", style, columns)
