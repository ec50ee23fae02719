"""What a recording shows of the judge's view of a run: events, identity lanes and counts, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...types import Ints
from ..replay import Incident, Replay
from .arrays import per_frame

EVENT_FRAMES = 10  # frames that an event stays in the picture


@dataclass(frozen=True)
class Lane:
    """Which track follows a true object: states from their first frame on, None where the object is not there."""

    object_id: int
    frame: tuple[int, ...]
    track: tuple[int | None, ...]  # -1: missed
    eventful: bool  # it carries a switch, a loss or a re-acquisition


def lanes(replay: Replay) -> list[Lane]:
    """Identity lanes of the evaluated objects, by their ids: the best hypothesis of every frame."""
    truth = replay.scene.truth
    frame = truth.frame_of_rows
    eventful = {i.object_id for i in replay.incidents if i.kind != "spurious"}
    track = np.append(replay.rollout.track_id, -1)[replay.truth_track]
    order = np.argsort(truth.object_id, kind="stable")
    order = order[~truth.neutral[order]]
    parts = np.split(order, np.flatnonzero(np.diff(truth.object_id[order])) + 1) if len(order) else []
    found = []
    for rows in parts:
        at, state = _changes(frame[rows], track[rows], replay.frames)
        object_id = int(truth.object_id[rows[0]])
        found.append(Lane(object_id, at, state, object_id in eventful))
    return found


def _changes(frame: Ints, track: Ints, frames: int) -> tuple[tuple[int, ...], tuple[int | None, ...]]:
    """Frames at which the state of one object changes, and the states; None from the frame after it was seen."""
    states: dict[int, int | None] = {}
    current: int | None = None
    for t, following, i in zip(frame.tolist(), [*frame[1:].tolist(), frames], track.tolist(), strict=True):
        if i != current:
            states[t] = current = i
        if following > t + 1:
            states[t + 1] = current = None
    return tuple(states), tuple(states.values())


def visible_incidents(replay: Replay) -> list[list[Incident]]:
    """The newest identity event of each object in the last frames, for every frame [F]."""
    shown: list[dict[int, Incident]] = [{} for _ in range(replay.frames)]
    for incident in replay.incidents:
        if incident.kind != "spurious":
            for now in shown[incident.frame : incident.frame + EVENT_FRAMES]:
                now[incident.object_id] = incident
    return [list(now.values()) for now in shown]


def visible_spurious(replay: Replay) -> tuple[Ints, NDArray[np.float32]]:
    """Number [F] and places [n, 3] of the forecasts of nothing in every frame."""
    rows = np.flatnonzero(replay.spurious)
    return per_frame(replay.rollout.object_start, rows), replay.rollout.object_box[rows, :3].astype(np.float32)


def counts(replay: Replay) -> dict[str, Ints]:
    """Series [F] per name: boxes right, missed and false in each frame; identity events so far."""
    series = {"TP": replay.true_positives, "FN": replay.false_negatives, "FP": replay.false_positives}
    for kind in ("ids", "lost", "reacquired"):
        frames = [i.frame for i in replay.incidents if i.kind == kind]
        series[kind] = np.cumsum(np.bincount(frames, minlength=replay.frames))
    return series
